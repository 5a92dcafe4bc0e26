"""The feature network (A.1): what it reads of a cloud, its layers, its weights and the features that it gives."""
