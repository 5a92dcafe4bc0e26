"""Dataset `humans`: people of different shape who walk, hop, punch and reach, with ground truth from their skeleton."""

from stages.ingest.humans.builder import build_human
from stages.ingest.humans.catalogue import EDITION, human_kind, human_names, human_split

__all__ = ["EDITION", "build_human", "human_kind", "human_names", "human_split"]
