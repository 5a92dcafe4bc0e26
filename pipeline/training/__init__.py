"""Training of the flow network: the folder that it leaves and goes on from, and the process that makes its batches."""
