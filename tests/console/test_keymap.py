from pathlib import Path

import pytest

from anaplot.console.keymap import default_path, keys_in_force, load_keymap
from anaplot.console.keys import ACTIONS
from anaplot.errors import InputError


def write(folder: Path, text: str) -> Path:
    path = folder / "keymap.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_no_default_key_means_two_things():
    keys = [key for keys in keys_in_force({}).values() for key in keys]
    assert len(keys) == len(set(keys))
    assert len({action.id for action in ACTIONS}) == len(ACTIONS)


def test_the_document_lists_every_action_with_its_default_keys():
    text = (Path(__file__).parents[2] / "docs" / "keymap.md").read_text(encoding="utf-8")
    listed = [line for line in text.splitlines() if line.startswith("| `")]
    assert listed == [f"| `{a.id}` | `{a.keys}` | {a.help} |" for a in ACTIONS]


def test_a_keymap_is_read(tmp_path):
    more = 'far_up = "shift+up,alt+K,ctrl+pageup,shift+f5"\n'
    path = write(tmp_path, f'record = "f5, ctrl+r"\naccept = "A"\nadd_point = "+"\n{more}')
    keymap = load_keymap(path)
    assert keymap.pop("far_up") == "shift+up,alt+K,ctrl+pageup,shift+f5"
    assert keymap == {"record": "f5,ctrl+r", "accept": "A", "add_point": "+"}
    assert keys_in_force(keymap)["record"] == ("f5", "ctrl+r")


def test_two_keys_may_change_places(tmp_path):
    assert load_keymap(write(tmp_path, 'record = "n"\nnext_point = "space"\n'))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('recrod = "f5"', "line 1: recrod: unknown key (did you mean 'record'?)"),
        ('zzzzzz = "f5"', "line 1: zzzzzz: unknown key"),
        ("record = 5", "must be text, not"),
        ('record = "n"', "key 'n' would mean both record and next_point"),
        ('add_point = "?"', "would mean both"),
        ('add_point = "question_mark"', "would mean both"),
        ('record = "f99"', "'f99' is no key"),
        ('record = ""', "'' is no key"),
        ('record = "a,,b"', "'' is no key"),
        ('record = "ctrl+ctrl+a"', "is no key"),
        ('record = "hyperspace+a"', "is no key"),
        ('record = "ctrl+q"', "kept for leaving"),
        ('record = "shift+k"', "'shift+k' is no key: terminals send 'K'"),
        ('record = "alt+shift+k"', "terminals send 'alt+K'"),
        ('record = "ctrl+K"', "terminals send 'ctrl+k'"),
        ('record = "f5,ctrl+shift+K"', "terminals send 'ctrl+k'"),
        ('record = "\\u001b"', r"'\x1b' is no key"),
        ('"\\u001b[2J" = "f5"', r"\x1b[2J: unknown key"),
        ("record = = 1", "line 1"),
        ("[record]\nkey = 'a'", "must be text, not"),
    ],
)
def test_a_bad_keymap_is_one_line_naming_file_and_thing(tmp_path, text, says):
    path = write(tmp_path, text)
    with pytest.raises(InputError) as raised:
        load_keymap(path)
    assert str(raised.value).startswith(str(path))
    assert says in str(raised.value)
    assert "\n" not in str(raised.value)
    assert raised.value.exit_code == 2


def test_files_that_are_no_keymap(tmp_path):
    missing = tmp_path / "none.toml"
    with pytest.raises(InputError, match="file not found"):
        load_keymap(missing)
    assert load_keymap(missing, required=False) == {}
    with pytest.raises(InputError, match=str(tmp_path)):
        load_keymap(tmp_path)
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="not UTF-8"):
        load_keymap(binary)
    large = tmp_path / "large.toml"
    large.write_bytes(b"#" * 70_000)
    with pytest.raises(InputError, match="is not read"):
        load_keymap(large)


def test_where_the_users_keymap_lies(tmp_path):
    assert default_path({"XDG_CONFIG_HOME": str(tmp_path)}) == tmp_path / "anaplot/keymap.toml"
    for environment in ({}, {"XDG_CONFIG_HOME": ""}, {"XDG_CONFIG_HOME": "relative"}):
        assert default_path(environment) == Path.home() / ".config/anaplot/keymap.toml"
