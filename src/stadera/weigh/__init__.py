"""Weighing a standing robot from a log: mass, centre of mass, what was put on, and when."""

from stadera.weigh.diagnosis import Finding, diagnose
from stadera.weigh.in_motion import MotionWeighing, weigh_in_motion
from stadera.weigh.payload import PayloadEstimate, payload_link
from stadera.weigh.result import Change, Refusal, Timeline, Weighing
from stadera.weigh.settings import WeighSettings
from stadera.weigh.weigh import weigh

__all__ = [
    "Change",
    "Finding",
    "MotionWeighing",
    "PayloadEstimate",
    "Refusal",
    "Timeline",
    "WeighSettings",
    "Weighing",
    "diagnose",
    "payload_link",
    "weigh",
    "weigh_in_motion",
]
