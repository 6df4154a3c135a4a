"""Environment of the whole regression."""

import pytest

from tb.hdlsim import prepare_environment

prepare_environment()
pytest.register_assert_rewrite("tb.harness")


def pytest_collection_modifyitems(items):
    """Long tests first, so that no worker is alone with one of them at the end."""
    items.sort(key=lambda item: not item.nodeid.startswith("tb/system/"))
