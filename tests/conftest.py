"""What every test process needs: one thread of linear algebra, and to hear interrupts.

Several test processes share the processors. A command started in the background is told to ignore
interrupts, and hands that on to every process it starts, also to those that a test interrupts.
"""

import os
import signal

# before anything imports numpy, which reads them once
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
