"""A run while it goes on, as a page on this machine alone: `page_beside` a run, or for a folder or a robot."""
