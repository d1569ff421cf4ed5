from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from ppmc.geometry.tools.toolset import ToolSet, compile_tools
from ppmc.scene.sections.tooling import Tool


@pytest.fixture(scope="session")
def make_tools() -> Callable[[Mapping[str, Any]], ToolSet]:
    """Compile tools from what a scene's section would hold."""
    adapter = TypeAdapter(dict[str, Tool])

    def make(section: Mapping[str, Any]) -> ToolSet:
        return compile_tools(adapter.validate_python(section))

    return make


@pytest.fixture
def cloud() -> np.ndarray:
    """Points all round the origin."""
    return np.random.default_rng(3).uniform(-12.0, 12.0, (4000, 3))
