"""What may go wrong in an episode, and how often; needs no JAX."""

from dataclasses import dataclass, replace
from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, ConfigDict, Field
from pydantic.dataclasses import dataclass as configuration

from exosight.control.frame_check import GuardConfig
from exosight.control.valve import Valve
from exosight.validation import rising

Kind = Literal["constant", "snap", "steps", "ramp", "sine"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""What targets do until they drop to 0; `snap` is a constant one where the nominal system snaps."""

ControllerName = Literal["guarded", "adaptive", "learned", "unguarded", "oracle", "delayed-oracle"]
"""The scheduled law behind its guard; the adaptive controller; this with a learned correction, and the same
with full authority whatever it knows; the bound of all, which feels the true force at once and knows plant
and user; the same one, which knows the user as he was when the last usable frame was taken."""

Share = Annotated[float, Field(ge=0, le=1)]
Delay = Annotated[float, Field(ge=0, le=2)]
Positive = Annotated[float, Field(gt=0, le=10)]
Seconds = Annotated[float, Field(gt=0, le=1e4)]
Coefficient = Annotated[float, Field(ge=0, le=2)]
Relaxing = Annotated[float, Field(ge=0, le=0.9)]


@configuration(frozen=True, config=ConfigDict(extra="forbid"))
class StressConfig:
    """What may go wrong, and how often."""

    suite: Literal[1, 2] = 1
    """1: plants without friction and creep, whose actuators answer at once; 2: the same episodes with
    friction, creep, lag and dead time as well"""
    hold_seconds: Annotated[float, Field(ge=1.5, le=60)] = 3.0
    """time until the target drops [s]"""
    release_seconds: Annotated[float, Field(ge=1.1, le=60)] = 1.5
    """time after that [s]"""
    targets: Annotated[tuple[Positive, Positive], AfterValidator(rising)] | None = None
    """targets [unit of the sensor]; default: 0.1…0.4 N for the published system, shares of the largest
    reading within the limits for another"""
    latency: Annotated[tuple[Delay, Delay], AfterValidator(rising)] = (0.0, 0.3)
    """age of the frames [s], in whole steps of 0.1 s; one for each episode"""
    lag: Annotated[tuple[Delay, Delay], AfterValidator(rising)] | None = None
    """of the actuators [s]: time in which they go 63 % of the way to a command; one for each episode;
    default: 0 in suite 1, 0 to 0.3 in suite 2"""
    dead_time: Annotated[tuple[Delay, Delay], AfterValidator(rising)] | None = None
    """of the actuators [s]: time before anything of a command arrives; one for each episode; default: 0 in
    suite 1, 0 to 0.2 in suite 2"""
    friction: Annotated[tuple[Coefficient, Coefficient], AfterValidator(rising)] | None = None
    """Coulomb's coefficient of the contacts of two bodies [-]; one for each episode; default: none in
    suite 1, 0 to 0.6 in suite 2"""
    creep: Annotated[tuple[Relaxing, Relaxing], AfterValidator(rising)] | None = None
    """share of the rods' instantaneous modulus that relaxes [-]; one for each episode; default: none in
    suite 1, 0.05 to 0.2 in suite 2"""
    creep_time: Annotated[tuple[Seconds, Seconds], AfterValidator(rising)] = (0.3, 10.0)
    """in which it relaxes [s], even in its logarithm; one for each episode"""
    dropped: Annotated[tuple[Share, Share], AfterValidator(rising)] = (0.0, 0.2)
    """share of the frames that never come; one for each episode"""
    repeated: Annotated[tuple[Share, Share], AfterValidator(rising)] = (0.0, 0.1)
    """share of the frames in whose place the one before comes again"""
    bursts: Annotated[int, Field(ge=0, le=10)] = 2
    """spells of up to 1 s of noise or of something in front of the camera, in each episode"""
    wrong_plant: bool = True
    """the system differs from the one that the controller was tuned for: modulus, finger and mount of the
    published one, what `vary` tables say of a file's"""
    wrong_camera: bool = True
    """in every third episode the camera stands up to 2 mm off and is up to 3 % too near or too far"""
    moving_user: bool = True
    """in every other episode joints stiffen or soften, and rest flexed by up to 10°"""

    @property
    def beyond_first(self) -> "Ranges":
        """Ranges of friction, creep and valves: those given, else those of the suite."""
        usual = _SUITES[self.suite]
        return Ranges(
            self.lag or usual.lag,
            self.dead_time or usual.dead_time,
            self.friction or usual.friction,
            self.creep or usual.creep,
        )

    def complete(self) -> "StressConfig":
        """The same with the ranges of its suite where none are given."""
        found = self.beyond_first
        return replace(
            self, lag=found.lag, dead_time=found.dead_time, friction=found.friction, creep=found.creep
        )


@dataclass(frozen=True)
class Ranges:
    """What suites differ in, see the fields of `StressConfig`; an upper limit of 0: none.

    Friction: silicone and fabric on skin (see `exosight.exosuit.index`). Creep: silicones of soft robots
    relax within seconds to minutes (J. C. Case, E. L. White, R. K. Kramer, Soft Robotics 2, 2015, doi
    10.1089/soro.2015.0002; Z. Liao, M. Hossain, X. Yao, Mech. Mater. 144, 2020, doi
    10.1016/j.mechmat.2020.103366); share and times are chosen here, the times such that an episode shows
    them.
    """

    lag: tuple[float, float]
    dead_time: tuple[float, float]
    friction: tuple[float, float]
    creep: tuple[float, float]


_NONE = (0.0, 0.0)
_SUITES = {1: Ranges(_NONE, _NONE, _NONE, _NONE), 2: Ranges((0.0, 0.3), (0.0, 0.2), (0.0, 0.6), (0.05, 0.2))}


def guard_of(config: StressConfig) -> GuardConfig:
    """What the controllers are told of their actuators: how slow the slowest of the suite is."""
    found = config.beyond_first
    return GuardConfig(response_time=Valve(found.lag[1], found.dead_time[1]).response_time)
