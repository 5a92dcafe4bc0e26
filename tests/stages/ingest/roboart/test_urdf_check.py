"""What a URDF may not say ends in one line that names the file and the element."""

import random
import re

import numpy as np
import pytest

from schemas.config import RoboartConfig
from schemas.errors import InputError
from stages.ingest.roboart import build_from_urdf, urdf_check
from stages.ingest.roboart.articulated import ArticulatedRobot
from stages.ingest.roboart.descriptions import Description, description_digest
from stages.ingest.roboart.urdf import read_urdf

CONFIG = RoboartConfig(frames=2, points=32, novel_states=0)


def refusal(path, read=read_urdf):
    with pytest.raises(InputError) as caught:
        read(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message


def surface(path):
    return ArticulatedRobot.read(path, (), CONFIG)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('<axis xyz="0 2 1"/>', '<axis xyz="nan 0 1"/>', "joint 'shoulder': <axis xyz='nan 0 1'>: found nan"),
        ('<axis xyz="0 2 1"/>', '<axis xyz="0 1e400 1"/>', "joint 'shoulder': <axis xyz='0 1e400 1'>: found inf"),
        ('<axis xyz="0 2 1"/>', '<axis xyz="0 2"/>', "joint 'shoulder': <axis xyz='0 2'>: found 2 numbers, expected 3"),
        ('<axis xyz="0 2 1"/>', '<axis xyz="up"/>', "joint 'shoulder': <axis xyz='up'>: found no number"),
        ('xyz="0 0 0.25"', 'xyz="0 0 -inf"', "link 'upper', <visual>: <origin xyz='0 0 -inf'>: found -inf"),
        (
            'xyz="0 0 0.25"',
            'xyz="0 0 1e300"',
            "link 'upper', <visual>: <origin xyz='0 0 1e300'>: found a number beyond",
        ),
        ('rpy="0.1 0 0.3"', 'rpy="0.1 nan 0.3"', "joint 'shoulder': <origin rpy='0.1 nan 0.3'>: found nan"),
        ('multiplier="-0.5"', 'multiplier="nan"', "joint 'echo': <mimic multiplier='nan'>: found nan"),
        ('offset="0.6"', 'offset="-inf"', "joint 'echo': <mimic offset='-inf'>: found -inf"),
        ('mimic joint="shoulder"', 'mimic joint=""', "joint 'echo': found that it mimics a joint without a name"),
        ('lower="0.3"', 'lower="nan"', "joint 'shoulder': <limit lower='nan'>: found nan"),
        ('radius="0.06"', 'radius="inf"', "link 'upper', <visual>: <cylinder radius='inf'>: found inf"),
        (' length="0.5"', "", "link 'upper', <visual>: found <cylinder> without length"),
        ('size="0.4 0.4 0.2"', 'size="0.4 0.4 nan"', "link 'base', <visual>: <box size='0.4 0.4 nan'>: found nan"),
        ('<sphere radius="0.1"/>', "", "link 'slide', <visual>: found nothing in <geometry>"),
        ('<sphere radius="0.1"/>', '<capsule r="1"/>', "link 'slide', <visual>: found <capsule> in <geometry>"),
        ('<sphere radius="0.1"/>', "<mesh/>", "link 'slide', <visual>: found a <mesh> without a file name"),
        ('<sphere radius="0.1"/>', '<mesh filename="a.stl" scale="1 nan 1"/>', "<mesh scale='1 nan 1'>: found nan"),
        ('<link name="base">', '<link name="upper">', "link 'upper': found twice"),
        ('joint name="press"', 'joint name="elbow"', "joint 'elbow': found twice"),
        ('<link name="base">', '<link name="">', "link 2: found no name"),
        ('joint name="press"', "joint", "joint 3: found no name"),
        ('<link name="base">', '<link name="ba&#10;se">', r"link 'ba\\nse': found characters that cannot be printed"),
        ('<parent link="base"/>', "", "joint 'shoulder': found no parent link"),
        (
            '<child link="upper"/>',
            '<child link="fore"/>',
            "link 'fore' with two parents, by joints 'shoulder', 'elbow'",
        ),
        ('<child link="upper"/>', '<child link="hand"/>', "joint 'shoulder' of the unknown link 'hand'"),
        ('<parent link="base"/>', '<parent link="slide"/>', "link 'upper' in a loop, or hanging on one"),
        ('<link name="world">', '<link name="hall"/><link name="world">', "2 links without a parent: 'hall', 'world'"),
        ("<robot ", "<robots ", "found the element <robots>"),
        (
            '<axis xyz="0 2 1"/>',
            '<axis xyz="0,2,1"/>',
            "joint 'shoulder': <axis xyz='0,2,1'>: found no number in '0,2,1', expected 3 of them, set apart by spaces",
        ),
        ('xyz="0 0 0.25"', 'xyz="0, 0, 0.25"', "link 'upper', <visual>: <origin xyz='0, 0, 0.25'>: found no number"),
        ('rpy="0.1 0 0.3"', 'rpy="0.1,0,0.3"', "joint 'shoulder': <origin rpy='0.1,0,0.3'>: found no number"),
        ('lower="0.3"', 'lower="0_3"', "joint 'shoulder': <limit lower='0_3'>: found no number in '0_3'"),
        ('radius="0.06"', 'radius="\u0663"', "link 'upper', <visual>: <cylinder radius='\u0663'>: found no number"),
        ('<sphere radius="0.1"/>', '<mesh filename=""/>', "link 'slide', <visual>: found a <mesh> without a file name"),
    ],
)
def test_what_cannot_be_meant_is_refused_by_file_and_element(arm, before, after, message):
    text = arm.read_text()
    assert before in text
    text = text.replace(before, after, 1)
    arm.write_text(text.replace("</robot>", "</robots>") if "<robots" in text else text)
    assert re.search(message.replace("(", r"\("), refusal(arm))


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('radius="0.06"', 'radius="0"', "link 'upper': found a <cylinder> of size (0.0, 0.5) with no surface"),
        (
            'radius="0.06"',
            'radius="-0.06"',
            "link 'upper': found a <cylinder> of size (-0.06, 0.5), expected none below",
        ),
        ('size="0.4 0.4 0.2"', 'size="0.4 0 0"', "link 'base': found a <box> of size (0.4, 0.0, 0.0) with no surface"),
        ('size="0.4 0.4 0.2"', 'size="0.4 0.4 -1"', "link 'base': found a <box>"),
        ('radius="0.1"', 'radius="-1"', "link 'slide': found a <sphere>"),
    ],
)
def test_a_shape_that_nobody_could_see_is_refused(arm, before, after, message):
    arm.write_text(arm.read_text().replace(before, after, 1))
    assert message in refusal(arm, surface)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('lower="0.3" upper="2.5"', 'lower="-inf" upper="inf"'),  # no limit
        ('size="0.4 0.4 0.2"', 'size="0.4 0.4 0"'),  # a sheet
        ('link="upper"', 'link="left/upper"'),  # robots of several arms
        ('size="0.4 0.4 0.2"', 'size="0.4, 0.4, 0.2"'),
        # what is not read
        ('<link name="base">', '<link name="base"><inertial><mass value="abc"/><inertia ixx="1"/></inertial>'),
        ('<link name="world">', '<material name="m"><color rgba="a b c d"/></material><link name="world">'),
        ("<geometry>", '<material name="m"><color rgba="1,0,0,1"/></material><geometry>'),
        ("<child ", '<safety_controller soft_lower_limit="abc"/><calibration rising="abc"/><child '),
        (
            '<link name="world">',
            '<transmission><actuator><a:b xmlns:a="c"/></actuator></transmission><link name="world">',
        ),
    ],
)
def test_what_is_odd_but_plain_is_read(arm, before, after):
    text = arm.read_text().replace(before, after)
    arm.write_text(text.replace('name="upper"', 'name="left/upper"') if "left" in after else text)
    surface(arm)


def test_entities_of_a_document_type_are_never_unfolded(urdf):
    laughs = "".join(f'<!ENTITY l{n} "{f"&l{n - 1};" * 10}">' for n in range(1, 9))
    path = urdf.folder / "robot.urdf"
    path.write_text(f'<!DOCTYPE r [<!ENTITY l0 "ha">{laughs}]><robot name="&l8;"><link name="a"/></robot>')
    assert "found a document type declaration" in refusal(path)
    path.write_text('<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/hostname">]><robot name="&x;"/>')
    assert "found a document type declaration" in refusal(path)


def test_a_large_file_is_refused_unread(urdf, monkeypatch):
    monkeypatch.setattr("stages.ingest.roboart.mesh_files.MOST_URDF_MIB", 1e-3)
    path = urdf.write(urdf.link("a" * 2000))
    assert "MiB, expected at most" in refusal(path)


def test_repeated_shapes_may_not_fill_the_memory(arm, monkeypatch):
    monkeypatch.setattr("stages.ingest.roboart.surface.MOST_TRIANGLES", 50)
    assert "link 'upper': found more than 50 triangles" in refusal(arm, surface)


def test_long_names_and_words_are_cut(arm):
    text = arm.read_text()
    for before, after in (
        ('joint name="press"', f'joint name="elbow{"w" * 100_000}"><axis xyz="up"/></joint><joint name="press"'),
        ('<axis xyz="0 2 1"/>', f'<axis xyz="{"0 " * 100_000}"/>'),
        ('<child link="upper"/>', f'<child link="{"w" * 100_000}"/>'),
        ('type="continuous"', f'type="{"w" * 100_000}"'),
    ):
        arm.write_text(text.replace(before, after, 1))
        assert len(refusal(arm)) - len(str(arm)) < 500


def test_a_mesh_without_a_file_name_is_told_by_its_link_not_when_files_are_looked_up(arm):
    arm.write_text(arm.read_text().replace('<sphere radius="0.1"/>', '<mesh filename=""/>'))
    description_digest(Description(arm, ()))
    assert "link 'slide'" in refusal(arm)


VALUES = ("nan", "inf", "-1", "0", "1e400", "1e300", "-1e-300", "", "up", "1 2", "nan 0 0", "../x", "base", "fixed")


def test_no_mutation_of_a_description_ends_in_anything_but_a_sequence_or_one_line(arm):
    rng, text = random.Random(0), arm.read_text()
    patterns = [r'(?<==")[^"]*(?=")'] * 5 + [r'\w+="[^"]*"', r"<\w+ [^<>]*/>", r"<(joint|link) .*?</\1>"]
    for _ in range(100):
        mutated = text
        for _ in range(rng.randint(1, 3)):
            pattern = rng.choice(patterns)
            found = list(re.finditer(pattern, mutated))
            if found:
                start, end = rng.choice(found).span()
                mutated = mutated[:start] + (rng.choice(VALUES) if "(?<" in pattern else "") + mutated[end:]
        arm.write_text(mutated)
        outcome = sequence_or_refusal(arm)
        assert str(outcome).startswith(str(arm)) if isinstance(outcome, InputError) else np.isfinite(outcome).all()


def sequence_or_refusal(path):
    try:
        return build_from_urdf(path, (), CONFIG, np.random.default_rng(0))[0]
    except InputError as error:
        return error


def test_every_number_that_is_read_is_checked():
    assert set(urdf_check.SHAPES) <= set(urdf_check.NUMBERS)
