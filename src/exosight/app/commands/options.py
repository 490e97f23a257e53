"""Options that several commands have."""

from pathlib import Path
from typing import Annotated

import tyro
from pydantic import Field

Json = Annotated[str | None, tyro.conf.arg(metavar="FILE|-", help_behavior_hint="")]
"""Where to write JSON: a new file, or stdout."""

MaybePath = Annotated[Path | None, tyro.conf.arg(help_behavior_hint="")]
"""A place that may be left out; the help says what happens then."""

SystemName = Annotated[str, tyro.conf.arg(metavar="NAME|FILE")]
"""A preset, or a system file."""

Name = Annotated[str | None, tyro.conf.arg(help_behavior_hint="")]
"""Of a sensor or a channel; the help says which is meant if it is left out."""

Seed = Annotated[int, Field(ge=0)]
