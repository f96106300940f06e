"""A measure of UFL that knows groups of facets and cells by name; it is imported with UFL."""

from __future__ import annotations

from typing import Any

import ufl


class GroupMeasure(ufl.Measure):
    """A measure over the blocks; `measure("back")` and `measure(("back", "top"))` are over groups.

    Attributes:
        groups: The groups, `forms.Groups`.
    """

    def __init__(self, plain: ufl.Measure, groups: Any) -> None:
        """A measure of UFL, with names."""
        super().__init__(
            plain.integral_type(),
            plain.ufl_domain(),
            plain.subdomain_id(),
            plain.metadata(),
            plain.subdomain_data(),
        )
        self.groups = groups

    def __call__(self, subdomain_id: Any = None, *more: Any, **options: Any) -> GroupMeasure:
        """The measure over a group or several, or with other options of UFL."""
        if isinstance(subdomain_id, (str, int, tuple)):
            names = subdomain_id if isinstance(subdomain_id, tuple) else (subdomain_id,)
            none = len(self.groups.sets)  # a number that no cell or facet has
            found = sorted(set().union(*map(self.groups.numbers, names))) or [none]
            subdomain_id = tuple(found)
        return super().__call__(subdomain_id, *more, **options)  # type: ignore[no-any-return]

    def reconstruct(self, *changes: Any, **options: Any) -> GroupMeasure:
        """UFL asks for a measure with changes here."""
        return GroupMeasure(super().reconstruct(*changes, **options), self.groups)
