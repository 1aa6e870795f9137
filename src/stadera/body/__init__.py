"""A legged robot as a floating tree with contacts: one set of rows for any of them."""

from stadera.body.tree import Body, Motion, State

__all__ = ["Body", "Motion", "State"]
