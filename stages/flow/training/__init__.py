"""Training of the flow stage's feature network: shapes that move, pairs of their clouds, and the loop (A.1)."""
