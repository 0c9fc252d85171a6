"""Seeds are fixed: a failure is one that everybody can repeat. Signals are as a terminal has them."""

import signal

from hypothesis import settings

settings.register_profile("fixed", derandomize=True, database=None)
settings.load_profile("fixed")

# a shell that starts the suite in the background has SIGINT ignored, and every child would inherit that
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
