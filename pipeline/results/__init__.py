"""Views of artifacts for people and other programs: models, evaluations, pages and the status of a data set."""
