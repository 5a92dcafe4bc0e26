"""The feature network (A.1): its input, layers, weights and output features."""
