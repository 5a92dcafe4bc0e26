"""Another start for frames that are far apart: rigid bodies found one after the other, over all frames at once."""
