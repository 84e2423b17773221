"""The report of a run folder: figure data and tables first, drawing last."""
