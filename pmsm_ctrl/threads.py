"""How many threads the linear algebra may use: one.

Its matrices have some twenty columns. A second thread brings no time on the clock, and waits busily: 82 s of processor
in place of 44 s for the 24 logs of a small fleet, 13 s in place of 9 s for a log of 10 min.
"""

__all__ = ["ONE_THREAD"]

# read by the libraries when they are loaded
ONE_THREAD = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
