"""Service and control loop of Sinew, with identification, tuning and experiments."""

import os

# Before numpy is loaded. Threads of BLAS slow the narrow matrices here down by a factor of two and, while they spin for
# more work, occupy a processor that the control loop needs.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

__version__ = "0.1.0"
