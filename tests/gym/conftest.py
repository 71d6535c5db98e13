"""Shapes and types of `drpbench.gym` are checked too, as everywhere."""

import pytest
from jaxtyping import install_import_hook

pytest.importorskip("gymnasium", reason="Gymnasium is not installed (drpbench[gym])")
install_import_hook(["drpbench.gym"], "beartype.beartype")
