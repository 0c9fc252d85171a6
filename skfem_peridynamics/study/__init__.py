"""Error against run time, and the paper's theorems beside what is measured."""
