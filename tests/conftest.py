"""One thread of linear algebra for each test process: several of them share the processors."""

import os

# before anything imports numpy, which reads them once
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
