"""Colours of pages and figures, light and dark, each named by its CSS variable."""

COLOURS: dict[str, tuple[str, str]] = {
    "ink": ("#20262e", "#e4e8ee"),
    "soft": ("#566170", "#a3adba"),
    "line": ("#dfe4ea", "#343c47"),
    "paper": ("#ffffff", "#1b2027"),
    "ground": ("#f3f5f7", "#12161b"),
    "blue": ("#0b6bcb", "#62b0ff"),
    "orange": ("#c76a10", "#f0a34a"),
    "steel": ("#8d97a5", "#8793a3"),
    "green": ("#1a7f43", "#4cc47e"),
    "red": ("#b3261e", "#ff8478"),
    "purple": ("#8a4fbf", "#c79bf0"),
    "amber": ("#8a5a00", "#f0c35a"),
    "shell": ("#4a5666", "#8fa0b5"),
    "limb": ("#b4bdc9", "#aab6c6"),
    "drive": ("#39434f", "#56616f"),
    "foot": ("#15191e", "#4a5462"),
    "box": ("#e0902f", "#e0902f"),
    "green-tint": ("#e9f6ee", "#173324"),
    "gray-tint": ("#f0f2f4", "#262d36"),
    "red-tint": ("#fcecea", "#3d1f1d"),
    "amber-tint": ("#fff6e0", "#3a2f14"),
}
"""By name, on white and on black; shell to box are a robot's parts and its load, in figures and in the demo. Text
colours have a contrast of 4.5 or more to `paper` (WCAG 2.2, AA).
"""

ROLES: dict[str, str] = {
    "measured": "ink",
    "identified": "blue",
    "prior_friction": "orange",
    "prior": "steel",
    "truth": "green",
    "limit": "red",
}
"""Colour of each kind of curve."""


def light(name: str) -> str:
    """Colour on white, for printed figures."""
    return COLOURS[name][0]


def style_variables() -> str:
    """All colours as CSS variables, dark if the reader's system is; print is always light."""
    on_white, on_black = ("".join(f"--{name}:{c[k]};" for name, c in COLOURS.items()) for k in (0, 1))
    dark = f"@media screen and (prefers-color-scheme:dark){{:root{{color-scheme:dark;{on_black}}}}}"
    return f":root{{color-scheme:light;{on_white}}}{dark}"
