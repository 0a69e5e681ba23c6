"""Readers lose no byte, whatever they are given, and edits touch their spans alone."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bumpstop.errors import InputError
from bumpstop.program.languages.blocks import moves_unseen
from bumpstop.program.languages.krl import parse_krl, read_krl
from bumpstop.program.languages.message_syntax import parse_json, parse_yaml
from bumpstop.program.languages.rapid import parse_rapid, read_rapid
from bumpstop.program.languages.statements import ReadProgram, short
from bumpstop.program.languages.syntax import Edit, SyntaxTree, edited
from bumpstop.program.languages.urscript import parse_urscript, read_urscript
from program.corpora import EXAMPLES, KRL, RAPID, URSCRIPT, mutated

Parse = Callable[[bytes], SyntaxTree]
Read = Callable[[bytes], ReadProgram]
LANGUAGES = [(parse_urscript, read_urscript, URSCRIPT), (parse_krl, read_krl, KRL), (parse_rapid, read_rapid, RAPID)]


def _check(parse: Parse, read: Read, source: bytes) -> None:
    tree = parse(source)
    assert tree.text() == source
    at = 0
    for token in tree.tokens():
        assert token.start == at
        assert token.end > token.start
        at = token.end
    assert at == len(source)
    lines = source.count(b"\n") + 1
    assert all(1 <= line <= lines for line, _ in read(source).not_understood)


@pytest.mark.parametrize(("parse", "read", "corpus"), LANGUAGES, ids=["urscript", "krl", "rapid"])
def test_the_tree_prints_the_same_bytes(parse: Parse, read: Read, corpus: tuple[bytes, ...]) -> None:
    for source in corpus:
        _check(parse, read, source)
    for seed in range(150):
        _check(parse, read, mutated(corpus, seed))


@pytest.mark.parametrize(("parse", "read", "corpus"), LANGUAGES, ids=["urscript", "krl", "rapid"])
def test_a_mark_of_the_byte_order_means_nothing(parse: Parse, read: Read, corpus: tuple[bytes, ...]) -> None:
    """Editors of Windows write it; the first line was not understood."""
    for source in (corpus[0], corpus[0].lstrip(b"# \n")):
        _check(parse, read, b"\xef\xbb\xbf" + source)
        assert read(b"\xef\xbb\xbf" + source).not_understood == read(source).not_understood


@pytest.mark.parametrize(("parse", "read"), [one[:2] for one in LANGUAGES], ids=["urscript", "krl", "rapid"])
def test_any_bytes(parse: Parse, read: Read) -> None:
    @given(st.binary(max_size=200))
    @settings(max_examples=60, deadline=None)
    def same(source: bytes) -> None:
        _check(parse, read, source)

    same()


@pytest.mark.parametrize("name", ["planned.json", "planned.yaml"])
def test_values_of_a_document_know_their_bytes(name: str) -> None:
    source = (EXAMPLES / name).read_bytes()
    parse = parse_json if name.endswith("json") else parse_yaml
    scalars = [scalar for document in parse(source, name) for scalar in document.scalars()]
    assert len(scalars) > 100
    for scalar in scalars:
        written = source[scalar.start : scalar.end].decode()
        assert written.strip("\"'") == scalar.text
    assert edited(source, [Edit(s.start, s.end, source[s.start : s.end].decode()) for s in scalars]) == source


def test_yaml_with_other_letters_and_a_byte_order_mark() -> None:
    source = "\ufeffnäme: [1.5, 'ü', 2e0]\nother: x\n".encode()
    (document,) = parse_yaml(source, "x")
    assert [source[s.start : s.end] for s in document.scalars()] == [b"1.5", "'ü'".encode(), b"2e0", b"x"]
    assert document.items[0].items[2].number() == 2.0
    assert document.items[0].items[1].number() is None


@pytest.mark.parametrize(
    ("text", "problem"),
    [(b"{", "JSON"), (b"[1,]", "JSON"), (b"[" * 40 + b"]" * 40, "JSON"), (b'{"a" 1}', "JSON"), (b"[1] 2", "JSON")],
)
def test_damaged_json_is_refused(text: bytes, problem: str) -> None:
    with pytest.raises(InputError, match=f"plan: is not valid {problem}"):
        parse_json(text, "plan")


@pytest.mark.parametrize("text", [b"a: [1", b"\xff\xfe", b"a: &x 1\nb: *x\n", b"[" * 40 + b"]" * 40])
def test_damaged_yaml_is_refused(text: bytes) -> None:
    with pytest.raises(InputError, match=r"^plan: "):
        parse_yaml(text, "plan")


def test_edits_touch_their_spans_alone() -> None:
    assert edited(b"v=0.25, a=1", [Edit(11, 11, ")"), Edit(2, 6, "0.1")]) == b"v=0.1, a=1)"
    with pytest.raises(ValueError, match="overlap"):
        edited(b"abcdef", [Edit(1, 4, "x"), Edit(3, 5, "y")])


@given(st.floats(1e-6, 9e5))
def test_a_written_number_is_never_above_its_value(value: float) -> None:
    assert value * (1 - 2e-3) <= float(short(value)) <= value * (1 + 1e-12)


@pytest.mark.parametrize(
    ("language", "opening", "closing"),
    [
        (0, b"while True:\n", b"end\n"),
        (0, b"if x:\n", b""),
        (1, b"FOR I=1 TO 6\n", b"ENDFOR\n"),
        (1, b"IF X THEN\n", b""),
        (2, b"WHILE TRUE DO\n", b"ENDWHILE\n"),
    ],
)
def test_blocks_without_end_do_not_exhaust_the_stack(language: int, opening: bytes, closing: bytes) -> None:
    _, read, _ = LANGUAGES[language]
    program = read(5000 * opening + 5000 * closing)
    assert any(text == "a block inside of 40 others" for _, text in program.not_understood)
    assert any(moves_unseen(body) for body in program.functions.values())
    shallow = read(20 * opening + 20 * closing)
    assert not any("inside of" in text for _, text in shallow.not_understood)
