"""Environment of the whole regression."""

import signal

import pytest

from tb.hdlsim import prepare_environment

pytest_plugins = ["tb.unchanged"]

prepare_environment()
# A shell starts its background jobs with interrupts ignored, and tests send some.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
pytest.register_assert_rewrite("tb.harness")
