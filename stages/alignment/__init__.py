"""Alignment of frames that have coordinates of their own."""

VERSION = 1
