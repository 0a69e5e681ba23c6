"""What is on screen: always a scenario, with every earlier one to go back to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bumpstop.collision.scenario.keys import drop_assumed, set_keys
from bumpstop.collision.scenario.scenario import Scenario
from bumpstop.collision.scenario.settings_file import with_absolute_paths
from bumpstop.errors import InputError
from bumpstop.text_files import to_toml, toml_value
from bumpstop.view.field_text import PREFIX, text_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

# Steps back that are kept: a day of clicks must not fill the memory.
_MAX_STEPS = 500


def with_keys(scenario: Scenario, changes: Mapping[str, Any]) -> Scenario:
    """A copy of a scenario with some keys changed, or taken out.

    Args:
        scenario: checked.
        changes: dotted keys and their new values; None takes the key out.

    Raises:
        InputError: the changed scenario is none.
    """
    data = scenario.as_given()
    for key in (key for key, value in changes.items() if value is None):
        table, name = _place(data, key)
        table.pop(name, None)
    set_keys(data, {key: value for key, value in changes.items() if value is not None})
    drop_assumed(data, changes)
    return Scenario.from_dict(data, scenario.folder)


def taken_out(scenario: Scenario, changes: Mapping[str, Any]) -> dict[str, Any]:
    """The keys that changes take out of a scenario, of those that it gives, and their values in it.

    Args:
        scenario: before the changes.
        changes: dotted keys and their new values; None takes the key out.
    """
    data, found = scenario.as_given(), {}
    for key in (key for key, value in changes.items() if value is None):
        table, name = _place(data, key)
        if name in table:
            found[key] = table[name]
    return found


def taken_out_words(gone: Mapping[str, Any]) -> str:
    """What is said of keys that went with another one, and of their values."""
    given = (
        f"{key} = {text_of(value) if key.startswith(PREFIX) else toml_value(value)}" for key, value in gone.items()
    )
    return f"Taken out with this change: {', '.join(given)}. Undo brings it back."


def _place(data: dict[str, Any], key: str) -> tuple[dict[str, Any], str]:
    """The table in which a dotted key stands, and its name there."""
    # The keys of [uncertainty] are dotted themselves.
    *tables, name = key.split(".", 1 if key.startswith("uncertainty.") else -1)
    here: Any = data
    for table in tables:
        here = here.get(table, {})
    return here, name


def scenario_text(scenario: Scenario) -> str:
    """A scenario as TOML, the keys that were given and paths absolute: the file may stand in any folder."""
    data = with_absolute_paths(scenario, scenario.as_given())
    return to_toml({key: value for key, value in data.items() if value != {}})


@dataclass(frozen=True)
class ViewDocument:
    """A scenario, and those before and after it in the order of changes. Immutable.

    Attributes:
        scenario: on screen.
        past: earlier scenarios, the latest last.
        future: scenarios that were undone, the next last.
        changed: the keys of the last change: one more of the same keys is the same step.
    """

    scenario: Scenario
    past: tuple[Scenario, ...] = ()
    future: tuple[Scenario, ...] = ()
    changed: frozenset[str] = frozenset()

    def edit(self, changes: Mapping[str, Any], *, same_step: bool = False) -> ViewDocument:
        """The document after a change; the same document where nothing changes.

        Args:
            changes: dotted keys and their new values; None takes the key out.
            same_step: a change of the keys of the last change is undone together with it, as of a slider that moves.

        Raises:
            InputError: the changed scenario is none; the document stays as it is.
        """
        scenario = with_keys(self.scenario, changes)
        if scenario == self.scenario:
            return self
        keys = frozenset(changes)
        past = self.past if same_step and keys == self.changed else (*self.past, self.scenario)[-_MAX_STEPS:]
        return ViewDocument(scenario, past, (), keys)

    def replace(self, scenario: Scenario) -> ViewDocument:
        """The document with another scenario in its place, one step on."""
        return ViewDocument(scenario, (*self.past, self.scenario)[-_MAX_STEPS:])

    def undo(self) -> ViewDocument:
        """One step back; the same document at the first."""
        if not self.past:
            return self
        return ViewDocument(self.past[-1], self.past[:-1], (*self.future, self.scenario))

    def redo(self) -> ViewDocument:
        """The step that was undone last; the same document where none was."""
        if not self.future:
            return self
        return ViewDocument(self.future[-1], (*self.past, self.scenario), self.future[:-1])

    @property
    def text(self) -> str:
        """The scenario on screen as TOML."""
        return scenario_text(self.scenario)


def replayed(
    document: ViewDocument, changes: Iterable[tuple[Mapping[str, Any], str]], check: Callable[[Scenario], object]
) -> tuple[ViewDocument, dict[str, InputError]]:
    """A document after changes, one after the other, but for those that cannot be used.

    Args:
        document: to begin with.
        changes: as of :meth:`ViewDocument.edit`, each with the key of its control.
        check: raises an :class:`InputError` where a scenario cannot be used.

    Returns:
        The document, and why changes were left out, by the keys of their controls.
    """
    refused = {}
    for each, key in changes:
        try:
            after = document.edit(each)
            if after is not document:
                check(after.scenario)
        except InputError as error:
            refused[key] = error
        else:
            document = after
    return document, refused
