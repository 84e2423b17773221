"""Measuring systems' formats: MDF, MAT, LabVIEW and Parquet as sources of columns."""
