"""Measuring systems' formats: MDF, TDMS, MAT, LabVIEW and Parquet as sources of columns."""
