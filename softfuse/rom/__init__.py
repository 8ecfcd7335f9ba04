"""What a reduced body is made from: many equilibria, their modes, and sparse sums over points."""
