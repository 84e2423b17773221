"""Bytes to columns: CSV, workbooks, MDF4, MAT, LVM, Parquet, TOML, with limits and locations in messages."""
