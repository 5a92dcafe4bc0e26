"""Labels of points: minimum cuts, matches between two segmentations, colours."""
