"""Enclosures of motions."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

ROOMS: tuple[Room, ...] = ()

EXCUSED: tuple[Excused, ...] = ()
