"""What stages share that is not mathematics: progress, swappable parts, and the use of heavy libraries."""
