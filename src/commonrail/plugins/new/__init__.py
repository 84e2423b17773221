"""Files to start from: a study, a study of data files, or a package with parts."""
