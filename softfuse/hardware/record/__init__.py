"""Sessions on disk: what came from the devices, what was made of it, and the way to CSV and Parquet."""
