"""Weighing a standing robot from a log: mass, centre of mass, what was put on, and when."""

from stadera.weigh.diagnosis import Finding, diagnose
from stadera.weigh.in_motion import MotionWeighing, weigh_in_motion
from stadera.weigh.model import WeighedModel, payload_link, weighed_model
from stadera.weigh.payload import PayloadEstimate
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
    "WeighedModel",
    "Weighing",
    "diagnose",
    "payload_link",
    "weigh",
    "weigh_in_motion",
    "weighed_model",
]
