"""A faulty problem file is refused with the file, the key, the value and what was expected."""

import json
import re
import tomllib

import pytest
from click.testing import CliRunner
from plans import MOTIONS, shipped, written

from trunk_ocp.cli.commands import main
from trunk_ocp.errors import InputError
from trunk_ocp.problem.build import load_motion, problems_folder

# A valid file in which every faulty one below differs by one line or two.
VALID = """
name = "study"
gravity = 9.8

[bounds]
activation = [-3.0, 0.0]
extension = [0.67, 1.35]
muscles = { "R1-dl" = [-2.0, 0.0] }
head_z_deg = [-10.0, 10.0]
head_y_deg = [-15.0, 15.0]

[[phases]]
name = "first"
duration = 1.0
bounds = { activation = [-2.5, 0.0] }

[[phases.targets]]
Z = 1.5
position = [0.6, 0.0, 1.2]
d3 = [0.0, 0.0, 1.0]

[[phases]]
name = "second"
duration = 0.5
steps = 2
loads.pull = { force = 10.0, held_from_step = 1 }
change = [{ activation = 0.3, head_z_deg = [-1.0, 2.0], head_y_deg = [-3.0, 4.0] }]

[phases.wrap]
Z = [1.4, 1.75]
points = 3
log_radius = 0.07
angles_deg = [90.0, -60.0]
center = [0.3, 0.0, 1.2]
position_weights = [1.0, 1.0, 1.0]
d3_weights = [0.0, 0.0, 0.0]

[contact]
log = true

[[obstacles]]
name = "post"
shape = "capsule"
from = [1.6, 0.2, 1.7]
to = [1.6, 0.2, -0.5]
radius = 0.06
phases = ["second"]
Z = [0.5, 1.7]

[[obstacles]]
name = "ground"
shape = "half-space"
point = [0.0, 0.0, 2.5]
normal = [0.0, 0.0, -2.0]

[[obstacles]]
name = "crate"
shape = "box"
center = [2.0, 0.0, 1.5]
half_sizes = [0.2, 0.3, 0.4]
rotation_deg = [0.0, 0.0, 30.0]
"""

# what is wrong | old text | new text | what the message must contain, piece by piece
FAULTS = r"""
unknown key | gravity = | gravty = | gravty & unknown key & Did you mean gravity?
unknown key in a phase | duration = 1.0 | duraton = 1.0 | phases[1] & duraton & duration?
unknown key in a target | d3 = [0.0, 0.0, 1.0] | d3_wieght = 1.0 | targets[1].d3_wieght & d3_weight?
unknown key in bounds | head_z_deg = [-10.0 | head_z = [-10.0 | bounds & head_z_deg?
unknown key in a change | { activation = 0.3 | { actvation = 0.3 | phases[2] & activation?
unknown key in a pull | { force = | { farce = | phases[2] & pull & farce & force?
unknown key in a wrap | points = 3 | pionts = 3 | phases[2] & wrap & pionts & points?
text for a number | duration = 1.0 | duration = "1" | phases[1] & duration & '1' & number
number for text | name = "first" | name = 7 | phases[1] & name & 7 & string
number for a list | d3 = [0.0, 0.0, 1.0] | d3 = 1.0 | targets[1] & d3 & 1.0
fraction of a step | steps = 2 | steps = 2.5 | phases[2] & steps & 2.5 & integer
truth for a number | Z = 1.5 | Z = true | targets[1] & Z & True & number
two of three coordinates | [0.6, 0.0, 1.2] | [0.6, 0.0] | targets[1] & position
four of three coordinates | [0.6, 0.0, 1.2] | [1.0, 2.0, 3.0, 4.0] | targets[1] & position
a comma for a point | [0.6, 0.0, 1.2] | [0,6, 0.0, 1.2] | targets[1].position & at most 3 & got 4 & 0.6
not a number | gravity = 9.8 | gravity = nan | gravity & nan & finite
infinity | force = 10.0 | force = inf | phases[2] & force & inf & finite
name that is no folder | "study" | "my/study" | name & my/study & letters, digits
unknown muscle | "R1-dl" | "R1-xl" | bounds.muscles & R1-xl & no such muscle & Did you mean R1-dl?
negative duration | duration = 1.0 | duration = -1.0 | phases[1] & duration & -1.0 & greater
no duration | duration = 1.0 | duration = 0.0 | phases[1] & duration & 0.0 & greater
no steps | steps = 2 | steps = 0 | phases[2] & steps & 0 & greater than 0
negative log radius | log_radius = 0.07 | log_radius = -0.07 | phases[2] & log_radius & -0.07
negative weight | position_weights = [1.0 | position_weights = [-1.0 | phases[2] & -1.0
negative change | activation = 0.3 | activation = -0.3 | phases[2] & change & activation & -0.3
negative Z | Z = 1.5 | Z = -0.1 | targets[1] & Z & -0.1 & greater
Z beyond the tip | Z = 1.5 | Z = 1.8 | targets[1].Z & 1.8 & 0 to 1.75 m
wrap beyond the tip | Z = [1.4, 1.75] | Z = [1.4, 1.76] | phases[2] & wrap.Z & 1.76 & 1.75 m
wrap before the base | Z = [1.4, 1.75] | Z = [-0.1, 1.75] | phases[2] & wrap.Z & -0.1 & 1.75 m
wrap backwards | Z = [1.4, 1.75] | Z = [1.75, 1.4] | phases[2] & wrap & increase & 1.75, 1.4
wrap of one point | points = 3 | points = 1 | phases[2] & wrap & points & 1 & 2
wrap around nothing | center = [0.3, 0.0, 1.2] |  | phases[2] & wrap & center or a path
too few weights | [1.0, 1.0, 1.0] | [1.0, 1.0] | phases[2] & position_weights & 3 points
too many weights | [0.0, 0.0, 0.0] | [0.0, 0.0, 0.0, 0.0] | phases[2] & d3_weights & 3 points
position and path | d3 = [0.0, 0.0, 1.0] | path = [[0, 0, 1], [0, 0, 2]] | targets[1] & not both
position and through | d3 = [0.0, 0.0, 1.0] | through = [[0, 0, 1], [0, 0, 2]] | targets[1] & position or through, not both
one way point | position = [0.6, 0.0, 1.2] | through = [[0.6, 0.0, 1.2]] | targets[1].through & at least 2
way point of two numbers | position = [0.6, 0.0, 1.2] | through = [[0.6, 0.0], [0.6, 0.1]] | targets[1].through[1] & at least 3
way points of both kinds | position = [0.6, 0.0, 1.2] | through = [[0.5, 0.6, 0.0, 1.2], [0, 0, 2]] | targets[1] & all [x, y, z] or all [t, x, y, z]
way points back in time | position = [0.6, 0.0, 1.2] | through = [[0.5, 0.6, 0.0, 1.2], [0.5, 0, 0, 2]] | targets[1] & through[2] & t = 0.5 s & increase
way point before the phase | position = [0.6, 0.0, 1.2] | through = [[-0.1, 0.6, 0.0, 1.2], [0.5, 0, 0, 2]] | targets[1] & through[1] & -0.1 s & 0 or later
way point after the phase | position = [0.6, 0.0, 1.2] | through = [[0.5, 0.6, 0.0, 1.2], [1.5, 0, 0, 2]] | phases[1] & t = 1.5 s & the phase at 1 s
wrap with both | center = [0.3, 0.0, 1.2] | center = [0.3, 0.0, 1.2]\nthrough = [[0, 0, 1], [0, 0, 2]] | phases[2].wrap & either a center
path of one point | position = [0.6, 0.0, 1.2] | path = [[0.6, 0.0, 1.2]] | targets[1] & path & at least 2
target of nothing | position = [0.6, 0.0, 1.2]\nd3 = [0.0, 0.0, 1.0] |  | targets[1] & needs a position
direction of no length | d3 = [0.0, 0.0, 1.0] | d3 = [0.0, 0.0, 0.0] | targets[1] & d3 & zero
held from itself | d3 = [0.0, 0.0, 1.0] | d3 = { held_from_step = 1 } | targets[1].d3.held_from_step = 1 & earlier
held from a later step | held_from_step = 1 | held_from_step = 3 | phases[2] & pull & 3 & earlier
held from step 0 | held_from_step = 1 | held_from_step = 0 | phases[2] & held_from_step & 0
change of no step | { activation = 0.3 | { steps = [2, 3], activation = 0.3 | phases[2] & 1 to 2
phase without target | [phases.wrap] | [[phases]]\nname = "x"\nduration = 1\n[phases.wrap] | phases[2] & targets or a wrap
no name | name = "study" |  | name & missing & required
no duration given | duration = 1.0 |  | phases[1] & duration & missing & required
no bounds on activation | activation = [-3.0, 0.0] |  | bounds.activation & missing
no bounds on extension | extension = [0.67, 1.35] |  | bounds.extension & missing
no Z | Z = 1.5 |  | targets[1] & Z & missing & required
unknown interpolation | steps = 2 | steps = 2\ninterpolation = "linear" | phases[2] & 'linear' & cosine & hermite
unknown anatomy | gravity = 9.8 | anatomy = "african-elephant" | anatomy & african & Did you mean asian-elephant?
contact force in the air | steps = 2 | steps = 2\nloads.contact_force = [0, 0, 1] | phases[2] & need contact_from
contact from the tip | steps = 2 | steps = 2\nloads.contact_from = 1.75 | contact_from = 1.75 & less than
extension below zero | [0.67, 1.35] | [-0.1, 1.35] | bounds & extension & -0.1 & 0 <
activation reversed | [-3.0, 0.0] | [0.0, -3.0] | bounds & activation & [0, -3] & above
extension reversed | [0.67, 1.35] | [1.35, 0.67] | bounds & extension & [1.35, 0.67]
muscle reversed | [-2.0, 0.0] | [0.0, -2.0] | bounds & muscles & R1-dl & [0, -2] & above
psi_Z reversed | [-10.0, 10.0] | [10.0, -10.0] | bounds & head_z_deg & [10, -10] & above
psi_Y reversed | [-15.0, 15.0] | [15.0, -15.0] | bounds & head_y_deg & [15, -15] & above
phase reversed | [-2.5, 0.0] | [0.0, -2.5] | phases[1] & bounds & activation & [0, -2.5] & above
change of psi_Z reversed | [-1.0, 2.0] | [2.0, -1.0] | phases[2] & change & head_z_deg & [2, -1]
unknown key of an obstacle | to = [1.6 | too = [1.6 | obstacles[1].too & unknown key & Did you mean to?
unknown shape | shape = "box" | shape = "cube" | obstacles[3].shape & 'cube' & sphere & half-space
no shape | shape = "box" |  | obstacles[3].shape & missing & required
key of another shape | radius = 0.06 | radius = 0.06\nnormal = [0.0, 0.0, 1.0] | obstacles[1] & takes from, to, radius & has no normal
missing radius | radius = 0.06 |  | obstacles[1] & takes from, to, radius & radius is missing
missing end | from = [1.6, 0.2, 1.7] |  | obstacles[1] & from is missing
negative radius | radius = 0.06 | radius = -0.06 | obstacles[1].radius & -0.06 & greater than 0
flat box | [0.2, 0.3, 0.4] | [0.2, 0.0, 0.4] | obstacles[3].half_sizes[2] & 0.0 & greater than 0
normal of no length | [0.0, 0.0, -2.0] | [0.0, 0.0, 0.0] | obstacles[2] & normal & zero
turned half-space | normal = | rotation_deg = [1, 2, 3]\nnormal = | obstacles[2] & point, normal & has no rotation_deg
capsule of no length | to = [1.6, 0.2, -0.5] | to = [1.6, 0.2, 1.7] | obstacles[1] & same point & sphere
two of one name | name = "ground" | name = "post" | obstacles[2].name & "post" & another solid
named like the log | name = "ground" | name = "log" | obstacles[2].name & "log" & another solid
unknown phase | phases = ["second"] | phases = ["third"] | obstacles[1].phases & "third" & first, second
no phase | phases = ["second"] | phases = [] | obstacles[1].phases & at least 1
part reversed | Z = [0.5, 1.7] | Z = [1.7, 0.5] | obstacles[1] & Z & [1.7, 0.5] & first < second
part beyond the tip | Z = [0.5, 1.7] | Z = [0.5, 1.8] | obstacles[1].Z & [0.5, 1.8] & 1.75 m
clearance below zero | phases = ["second"] | clearance = -0.1 | obstacles[1].clearance & -0.1 & greater
unknown frame | phases = ["second"] | frame = "body" | obstacles[1].frame & 'body' & head
unknown contact | log = true | logs = true | contact.logs & unknown key & Did you mean log?
contact by number | log = true | log = 1 | contact.log & 1 & boolean
change of psi_Y reversed | [-3.0, 4.0] | [4.0, -3.0] | phases[2] & change & head_y_deg & [4, -3]
"""  # noqa: E501  # one row a fault


def rows():
    for line in FAULTS.strip().splitlines():
        what, old, new, pieces = (part.strip() for part in line.split(" | "))
        old, new = (text.replace(r"\n", "\n") for text in (old, new))
        yield pytest.param(old, new, pieces.split(" & "), id=what)


def test_the_valid_file_is_valid(tmp_path):
    motion = load_motion(written(tmp_path, VALID))
    assert len(motion.steps) == 3


@pytest.mark.parametrize(("old", "new", "pieces"), list(rows()))
def test_a_fault_is_named(tmp_path, old, new, pieces):
    assert VALID.count(old) >= 1
    path = written(tmp_path, VALID.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        load_motion(path)
    message = str(caught.value)
    assert str(path) in message
    missing = [piece for piece in pieces if piece not in message]
    assert not missing, message


def test_all_faults_are_named_at_once(tmp_path):
    text = VALID.replace("gravity =", "gravty =").replace("duration = 1.0", "duration = -1.0")
    with pytest.raises(InputError, match=r"(?s)duration.*gravty|gravty.*duration"):
        load_motion(written(tmp_path, text))


@pytest.mark.parametrize("text", ["name = ", "[bounds\n", "a = 1\na = 2\n", 'x = "\x00"'])
def test_invalid_toml_is_refused(tmp_path, text):
    path = written(tmp_path, text)
    with pytest.raises(InputError, match="not valid TOML") as caught:
        load_motion(path)
    assert str(path) in str(caught.value)


def test_a_file_that_is_not_text_is_refused(tmp_path):
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\xff\xfe\x00name")
    with pytest.raises(InputError, match=r"binary\.toml.*not UTF-8 text"):
        load_motion(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=re.escape(str(tmp_path / "none.toml"))):
        load_motion(tmp_path / "none.toml")


def test_a_folder_is_not_a_problem_file(tmp_path):
    with pytest.raises(InputError, match=re.escape(str(tmp_path))):
        load_motion(tmp_path)


def test_a_misspelt_shipped_name_gets_a_suggestion():
    with pytest.raises(InputError, match=r"pick-friut.*lift-log.*Did you mean pick-fruit\?"):
        load_motion("pick-friut")


# --- the schema --------------------------------------------------------------------------


def printed_schema():
    result = CliRunner().invoke(main, ["schema"])
    assert result.exit_code == 0
    return result.stdout


def test_the_shipped_schema_is_the_printed_one():
    shipped = json.loads((problems_folder() / "problem.schema.json").read_text())
    assert shipped == json.loads(printed_schema())  # an older pydantic prints 0.0 for 0


def fits(value, rule, root):
    """Whether a value uses only keys, and has all keys, that a JSON Schema rule knows."""
    if "$ref" in rule:
        return fits(value, root["$defs"][rule["$ref"].rsplit("/", 1)[1]], root)
    if "anyOf" in rule:
        return any(fits(value, choice, root) for choice in rule["anyOf"])
    if isinstance(value, dict):
        if rule.get("type") != "object":
            return False
        known, other = rule.get("properties", {}), rule.get("additionalProperties", True)
        return set(rule.get("required", [])) <= set(value) and all(
            fits(v, known[k], root) if k in known else isinstance(other, dict)
            for k, v in value.items()
        )
    if isinstance(value, list):
        return rule.get("type") == "array" and all(
            fits(v, rule.get("items", True), root) if isinstance(rule.get("items"), dict) else True
            for v in value
        )
    kinds = {str: {"string"}, bool: {"boolean"}, int: {"integer", "number"}, float: {"number"}}
    return rule.get("type") in kinds[type(value)] and value in rule.get("enum", [value])


@pytest.mark.parametrize("name", MOTIONS)
def test_the_schema_knows_every_key_of_the_shipped_files(name):
    schema = json.loads(printed_schema())
    data = tomllib.loads((problems_folder() / f"{name}.toml").read_text())
    assert fits(data, schema, schema)
    assert not fits({**data, "gravty": 9.8}, schema, schema)
    assert shipped(name).spec.model_dump(exclude_unset=True).keys() == data.keys()


def test_the_schema_refuses_unknown_keys_everywhere():
    schema = json.loads(printed_schema())
    sections = [schema, *schema["$defs"].values()]
    assert all(s["additionalProperties"] is False for s in sections if "properties" in s)


@pytest.mark.parametrize("end", ["", "\n", "\n\n", "\nnext = 1\n"])
def test_a_key_that_is_there_twice_is_named_with_its_line(tmp_path, end):
    path = tmp_path / "problem.toml"
    path.write_text(f'name = "a"\ngravity = 9.8\nname = "b"{end}')
    with pytest.raises(InputError, match="line 3: name: this key exists already"):
        load_motion(path)
