"""What is told and written: sinks, trajectories, the folder of a run and where its result comes from."""
