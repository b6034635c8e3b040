"""Performance as ratios. Importing ``backend`` first, before numpy, keeps BLAS to one thread as in the service."""

import backend  # noqa: F401  (for its effect on numpy, see above)
