"""What a run writes and reports: sinks, trajectories, the folder of a run and its provenance."""
