"""Environment of the whole regression."""

import gc
import signal

import pytest

from tb.hdlsim import prepare_environment

pytest_plugins = ["tb.unchanged"]

prepare_environment()
# Tests make many objects and few cycles: to look for those as often as Python does takes a tenth.
gc.set_threshold(100_000, 20, 100)
# A shell starts its background jobs with interrupts ignored, and tests send some.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
pytest.register_assert_rewrite("tb.harness")
