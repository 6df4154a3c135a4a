"""Environment of the whole regression."""

import pytest

from tb.hdlsim import prepare_environment

pytest_plugins = ["tb.unchanged"]

prepare_environment()
pytest.register_assert_rewrite("tb.harness")
