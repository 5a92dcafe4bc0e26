"""What people and other programs read of artifacts: models, evaluations, pages, the status of a data set."""
