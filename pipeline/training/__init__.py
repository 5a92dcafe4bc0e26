"""Training of the flow network: its folder, from which it can resume, and the process that makes its batches."""
