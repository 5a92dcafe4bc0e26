"""Data set `humans`: people of different shape walk, hop, punch and reach. Their skeleton gives the ground truth."""

from stages.ingest.humans.builder import build_human
from stages.ingest.humans.catalogue import EDITION, human_kind, human_names, human_split

__all__ = ["EDITION", "build_human", "human_kind", "human_names", "human_split"]
