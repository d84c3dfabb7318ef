"""What the classes of options have in common."""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar, Mapping


class OptionGroup:
    """Fields with defaults; others cannot be set."""

    # Groups of the command line by their fields.
    _GROUPS: ClassVar[dict] = {}
    # The group that has no field, as its options are fields of the class itself,
    # and the names of these fields.
    _OWN_GROUP: ClassVar[str] = ""
    _OWN_FIELDS: ClassVar[set] = set()

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in type(self).__dataclass_fields__:
            raise AttributeError(f"{type(self).__name__} has no option {name!r}")
        if name in self._GROUPS and isinstance(value, Mapping):
            group = type(self)._default(name)
            group.mergedict(value)
            value = group
        super().__setattr__(name, value)

    @classmethod
    def _default(cls, name: str) -> Any:
        field = cls.__dataclass_fields__[name]
        if field.default_factory is not dataclasses.MISSING:
            return field.default_factory()
        return field.default

    def todict(self) -> dict:
        """Values by the names of the command line, such as "Group.field"."""
        values = {}
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if field.name in self._GROUPS:
                group = self._GROUPS[field.name]
                values.update({f"{group}.{k}": v for k, v in value.todict().items()})
            elif field.name in self._OWN_FIELDS:
                values[f"{self._OWN_GROUP}.{field.name}"] = value
            else:
                values[field.name] = value
        return values

    def mergedict(self, values: Mapping[str, Any]) -> None:
        """Sets options by the names of fields, or by those of the command line.

        Raises AttributeError for one that does not exist.
        """
        names = {group: name for name, group in self._GROUPS.items()}
        for key, value in values.items():
            group, _, field = key.partition(".")
            if group == self._OWN_GROUP and field in self._OWN_FIELDS:
                group, field = field, ""
            name = names.get(group, group)
            if field:
                if name not in self._GROUPS:
                    raise AttributeError(f"{type(self).__name__} has no option {key!r}")
                getattr(self, name).mergedict({field: value})
            elif name in self._GROUPS and isinstance(value, Mapping):
                getattr(self, name).mergedict(value)
            else:
                setattr(self, name, value)

    def changed(self) -> dict:
        """As todict(), of options that have not their default."""
        defaults = type(self)().todict()
        return {k: v for k, v in self.todict().items() if v != defaults[k]}

    def summary(self) -> str:
        """One line per option, as in a project file."""
        return "".join(f"{name}={value}\n" for name, value in self.todict().items())
