"""The flat table in files: CSV and Parquet."""
