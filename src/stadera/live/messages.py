"""Outgoing messages in CDR: trunk and payload as geometry_msgs/InertiaStamped, the state as diagnostics, and a
service's answer.

geometry_msgs/Inertia has the fields m, com, ixx, ixy, ixz, iyy, iyz, izz. Its definition states neither the point nor
the axes of the tensor; here they are those of a URDF's <inertial>: about the centre of mass, in the axes of the
header's frame, which is the trunk link. (The ten parameters of this package are about the link's origin.) Products of
inertia are tensor components, ixy = -∫xy dm, as in a URDF.
"""

from __future__ import annotations

import json
import time
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from stadera.live.state import LiveState
from stadera.types import Array

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

INERTIA = "geometry_msgs/msg/InertiaStamped"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
STRING = "std_msgs/msg/String"
TRIGGER = "std_srvs/srv/Trigger"
TRIGGER_HASH = "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"
"""The hash of a service's type (REP 2016) covers request, response and event; rosbags supports messages only."""

TRUNK, PAYLOAD, STATE, DIAGNOSIS = "stadera/trunk", "stadera/payload", "stadera/state", "stadera/diagnostics"
TARE, RESET = "stadera/tare", "stadera/reset"
KINDS = {TRUNK: INERTIA, PAYLOAD: INERTIA, STATE: STRING, DIAGNOSIS: DIAGNOSTICS, TARE: TRIGGER, RESET: TRIGGER}
"""Topics and services, and their ROS types; outside ROS the state is plain JSON."""

_LEVELS = {"good": 0, "doubtful": 1, "bad": 2, "stale": 3}
_RESPONSE = "std_srvs/msg/TriggerResponse"


@cache
def types() -> Typestore:
    """The message definitions."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    from stadera.logs.bags.decode import published
    from stadera.logs.bags.unitree import LOW_STATES

    store = get_typestore(Stores.ROS2_HUMBLE)
    own = {kind: published(kind) for kind in LOW_STATES}
    for kind, definition in {**own, _RESPONSE: "bool success\nstring message\n"}.items():
        store.register(get_types_from_msg(definition, kind))
    return store


@cache
def type_hash(kind: str) -> str:
    """REP 2016's hash of a message's or of the service's type."""
    return TRIGGER_HASH if kind == TRIGGER else str(types().hash_rihs01(kind))


def of_state(state: LiveState) -> dict[str, bytes]:
    """Messages for a state, by topic: always the state as JSON and as diagnostics.

    Also the trunk as a physically possible body, with the model's values for unobserved quantities, and after a tare
    the payload. Both are sent only while samples arrive and the verdict is not "bad".
    """
    text = json.dumps(state.to_dict(), allow_nan=False)
    out = {STATE: text.encode(), DIAGNOSIS: _diagnostics(state, time.time_ns())}
    if state.is_trusted and state.stamp:
        body, payload = state.trunk.inertial, state.payload
        out[TRUNK] = _inertia(body.mass, body.com, body.inertia_com, state.link, state.stamp)
        if payload is not None:  # NaN if centre of mass or inertia were not observed
            tensor = np.full((3, 3), np.nan) if payload.inertia is None else payload.inertia
            out[PAYLOAD] = _inertia(payload.mass, payload.com, tensor, payload.at or state.link, state.stamp)
    return out


def _diagnostics(state: LiveState, stamp: int) -> bytes:
    """Encodes the state as one status: OK for a good verdict, WARN for doubtful, ERROR for bad, STALE while waiting."""
    make = types().types
    level = _LEVELS["stale" if state.waiting_for else state.trust.verdict]
    text = "; ".join(state.waiting_for or state.trust.reasons) or "figures and error bars hold"
    values = [make["diagnostic_msgs/msg/KeyValue"](key, value) for key, value in state.figures().items()]
    status = make["diagnostic_msgs/msg/DiagnosticStatus"](level, "stadera", text, state.robot, values)
    return _cdr(make[DIAGNOSTICS](_header(stamp, ""), [status]), DIAGNOSTICS)


def text_message(text: str) -> bytes:
    """A std_msgs/String."""
    return _cdr(types().types[STRING](text), STRING)


def answer_message(success: bool, message: str) -> bytes:
    """Encodes the response of a std_srvs/Trigger."""
    return _cdr(types().types[_RESPONSE](success, message), _RESPONSE)


def _inertia(mass: float, com: Array, tensor: Array, frame: str, stamp: int) -> bytes:
    """Encodes a body as InertiaStamped, in the frame of the named link, at a stamp [ns]."""
    make = types().types
    six = (float(tensor[i, k]) for i in range(3) for k in range(i, 3))
    inertia = make["geometry_msgs/msg/Inertia"](mass, make["geometry_msgs/msg/Vector3"](*map(float, com)), *six)
    return _cdr(make[INERTIA](_header(stamp, frame), inertia), INERTIA)


def _header(stamp: int, frame: str) -> Any:
    make = types().types
    return make["std_msgs/msg/Header"](make["builtin_interfaces/msg/Time"](*divmod(stamp, 1_000_000_000)), frame)


def _cdr(message: Any, kind: str) -> bytes:
    return bytes(types().serialize_cdr(message, kind))
