"""Draws docs/data_flow.svg: the stages, and which artifact each reads. Run it from anywhere; it needs Python only."""

from html import escape
from pathlib import Path

OUT = Path(__file__).parents[1] / "docs" / "data_flow.svg"
WIDTH, HEIGHT = 1000, 600
BOX = (210, 78)
COLUMNS = (24, 272, 520, 766)
ROWS = (54, 214, 372, 496)

# name: column, row, what it decides, the artifact that it writes (schemas/)
STAGES = {
    "ingest": (1, 0, "normalised frames", "IngestedSequence"),
    "alignment": (2, 0, "common coordinates", "Alignment"),
    "flow": (3, 0, "matches between frames", "Flow"),
    "relaxed_fit": (0, 1, "parts and their free motions", "RelaxedModel"),
    "projection": (1, 1, "a tree with screw joints", "KinematicModel"),
    "merging": (2, 1, "which parts are one", "KinematicModel"),
    "final_fit": (3, 1, "joints, their kinds, labels", "KinematicModel"),
    "canonical_frame": (3, 2, "the best candidate", "CanonicalChoice"),
    "result": (2, 2, "model.json, model.npz", "Result"),
    "export": (1, 2, "robot.urdf, robot.xml", "Robot"),
    "report": (0, 2, "report.html, report.png", "Report"),
    "assessment": (3, 3, "spreads of joints, a verdict", "Assessment"),
    "evaluation": (2, 3, "metrics against the truth", "Metrics"),
}
STYLE = """
  .panel { fill: #ffffff; } .box { fill: #eef3fa; stroke: #33557f; } .outside { fill: none; stroke: #6b7785; }
  .group { fill: #f7f7f4; stroke: #8a8a80; stroke-dasharray: 6 4; } .arrow { fill: none; stroke: #33557f; }
  .tip { fill: #33557f; } text { fill: #1b2530; font-family: system-ui, sans-serif; font-size: 13px; }
  .name { font: 600 15px ui-monospace, monospace; } .soft { fill: #4d5966; font-size: 12px; }
  .schema { fill: #4d5966; font: 12px ui-monospace, monospace; }
  .box, .outside, .arrow { stroke-width: 1.5; }
  @media (prefers-color-scheme: dark) {
    .panel { fill: #14191f; } .box { fill: #1f2c3d; stroke: #8fb3e0; } .outside { stroke: #8c98a5; }
    .group { fill: #1a1f25; stroke: #77776e; } .arrow { stroke: #8fb3e0; } .tip { fill: #8fb3e0; }
    text { fill: #e6ebf0; } .soft, .schema { fill: #aeb9c4; }
  }
"""


def corner(stage: str) -> tuple[int, int]:
    column, row, *_ = STAGES[stage]
    return COLUMNS[column], ROWS[row]


def side(stage: str, at: str, shift: int = 0) -> tuple[int, int]:
    """The middle of a box's side, moved along it."""
    (x, y), (width, height) = corner(stage), BOX
    return {
        "left": (x, y + height // 2 + shift),
        "right": (x + width, y + height // 2 + shift),
        "top": (x + width // 2 + shift, y),
        "bottom": (x + width // 2 + shift, y + height),
    }[at]


def box(stage: str) -> str:
    (x, y), (width, height) = corner(stage), BOX
    _, _, what, schema = STAGES[stage]
    return (
        f'<rect class="box" x="{x}" y="{y}" width="{width}" height="{height}" rx="6"/>'
        + text(x + 12, y + 23, stage, "name")
        + text(x + 12, y + 45, what)
        + text(x + 12, y + 65, schema, "schema")
    )


def text(x: int, y: int, words: str, kind: str = "plain") -> str:
    return f'<text class="{kind}" x="{x}" y="{y}">{escape(words)}</text>'


def arrow(*points: tuple[int, int]) -> str:
    path = " ".join(f"{x},{y}" for x, y in points)
    return f'<polyline class="arrow" points="{path}" marker-end="url(#tip)"/>'


def picture() -> str:
    sources_x, sources_y = COLUMNS[0], ROWS[0]
    width, height = BOX
    above = ROWS[1] - 46  # where what the flow gives is handed on
    below = ROWS[2] - 26
    between = (ROWS[2] + height + ROWS[3]) // 2
    gap = (COLUMNS[2] + width + COLUMNS[3]) // 2
    parts = [
        f'<rect class="panel" width="{WIDTH}" height="{HEIGHT}" rx="8"/>',
        f'<rect class="group" x="10" y="{ROWS[1] - 32}" width="{WIDTH - 20}" height="{height + 48}" rx="10"/>',
        text(
            COLUMNS[1],
            ROWS[1] - 12,
            "once for each candidate canonical frame; later candidates take over the first one's parts",
            "soft",
        ),
        f'<rect class="outside" x="{sources_x}" y="{sources_y}" width="{width}" height="{height}" rx="6"/>',
        text(sources_x + 12, sources_y + 23, "a source"),
        text(sources_x + 12, sources_y + 45, "files of frames, or a data set", "soft"),
        text(sources_x + 12, sources_y + 65, "stages/ingest/sources.py", "schema"),
        text(
            COLUMNS[0],
            ROWS[3] + 66,
            "Later stages also read the sequence of ingest: up to the choice in common",
            "soft",
        ),
        text(COLUMNS[0], ROWS[3] + 84, "coordinates. Only evaluation and report use its ground truth.", "soft"),
        text(24, 30, "What each stage reads and writes", "name"),
        *map(box, STAGES),
        arrow((sources_x + width, sources_y + height // 2), side("ingest", "left")),
        arrow(side("ingest", "right"), side("alignment", "left")),
        arrow(side("alignment", "right"), side("flow", "left")),
        arrow(
            side("flow", "bottom", -30),
            (side("flow", "bottom", -30)[0], above),
            (side("relaxed_fit", "top", 60)[0], above),
            side("relaxed_fit", "top", 60),
        ),
        arrow(
            side("flow", "bottom", 30),
            (side("flow", "bottom", 30)[0], above),
            (side("final_fit", "top")[0], above),
            side("final_fit", "top"),
        ),
        arrow(side("relaxed_fit", "right"), side("projection", "left")),
        arrow(side("projection", "right"), side("merging", "left")),
        arrow(side("merging", "right"), side("final_fit", "left")),
        arrow(side("final_fit", "bottom"), side("canonical_frame", "top")),
        arrow(side("canonical_frame", "left"), side("result", "right")),
        arrow(side("result", "left"), side("export", "right")),
        arrow(side("export", "left"), side("report", "right")),
        arrow(
            side("result", "top"),
            (side("result", "top")[0], below),
            (side("report", "top")[0], below),
            side("report", "top"),
        ),
        arrow(side("canonical_frame", "bottom", 40), side("assessment", "top", 40)),
        arrow(
            side("canonical_frame", "bottom", -60),
            (side("canonical_frame", "bottom", -60)[0], between),
            (side("evaluation", "top", 60)[0], between),
            side("evaluation", "top", 60),
        ),
        arrow(
            side("assessment", "left", -15),
            (gap, side("assessment", "left", -15)[1]),
            (gap, side("result", "right", 20)[1]),
            side("result", "right", 20),
        ),
        arrow(side("assessment", "left", 15), side("evaluation", "right", 15)),
        arrow(
            side("evaluation", "left"),
            (side("report", "bottom")[0], side("evaluation", "left")[1]),
            side("report", "bottom"),
        ),
    ]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
        f'role="img" aria-label="The stages, and which artifact each reads">\n<style>{STYLE}</style>\n'
        '<defs><marker id="tip" markerWidth="9" markerHeight="8" refX="8" refY="4" orient="auto">'
        '<path class="tip" d="M0,0 L9,4 L0,8 z"/></marker></defs>\n' + "\n".join(parts) + "\n</svg>\n"
    )


if __name__ == "__main__":
    OUT.write_text(picture(), encoding="utf-8")
