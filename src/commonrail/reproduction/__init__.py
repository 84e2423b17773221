"""The experiments of Lino, Maione, Saponaro, Li (2016), Sec. 5, rerun on the virtual test bench."""
