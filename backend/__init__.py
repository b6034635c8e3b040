"""Sinew's service, control loop and method."""

import os

# Before numpy is loaded. The matrices here are narrow: threads of BLAS make them slower by a factor of two and, while
# they spin for more work, take a processor from the control loop.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

__version__ = "0.1.0"
