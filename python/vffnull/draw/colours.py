"""Colours that figures and pages share, without a library that draws."""

from __future__ import annotations

CONTACT, NEAR, FREE = (200, 20, 40), (230, 130, 30), (196, 204, 214)
"""Colours of a link in space in contact, half way into the influence distance, and out of it."""
