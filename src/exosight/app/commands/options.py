"""Options that several commands have."""

from typing import Annotated

import tyro
from pydantic import Field

Json = Annotated[str | None, tyro.conf.arg(metavar="FILE|-")]
"""Where to write JSON: a new file, or stdout."""

Seed = Annotated[int, Field(ge=0)]
