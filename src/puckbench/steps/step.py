"""What a step is, i.e. the work of one rule of the workflow, and the registry of all steps.

A step is a class in a module that is named like its rule::

    @STEPS.register("sample")
    class Sample(Step):
        points: int = 500_000

        @classmethod
        def of_plan(cls, flow, dataset, cloud):  # one parameter for each wildcard of the rule
            settings = flow.plan.datasets[dataset].settings
            return planned(cls(points=settings.points), {"scene": flow.files.scene(dataset, cloud)})

        def run(self, mesh: Path, cloud: Path) -> dict[str, Any]: ...

The fields of the class are the settings of the step. They are written in the rule's command, with
the files that `Step.run` takes.
"""

from __future__ import annotations

import hashlib
import shlex
from abc import abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, get_type_hints

from pointkit.models import Model, parsed
from pointkit.registry import Registry, trust
from puckbench.steps.fingerprints import code_version

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

Paths = tuple[Path, ...]
"""Type of a parameter of `Step.run` that takes several files."""
Inputs = Mapping[str, str | Sequence[str]]
"""Path or paths of each input of a rule, by the input's name."""


class Step(Model):
    """Base class of steps, whose fields are the settings."""

    @classmethod
    def of_plan(cls, flow: Workflow, /, *args: Any, **wildcards: Any) -> PlannedStep:
        """Return the step as it is planned for the values of its rule's wildcards.

        Subclasses name the wildcards as parameters.
        """
        raise NotImplementedError(f"{cls.__name__} has no rule")

    @classmethod
    def create(cls, **settings: Any) -> Self:
        """Return a step with checked settings; raise InputError if one is invalid."""
        return cls.checked(settings, cls.__name__.lower())

    @classmethod
    def checked(cls, settings: Any, what: str) -> Self:
        """Return a step with given settings, and permit the import of the plug-ins they name.

        Parameters
        ----------
        settings
            Dictionary of settings, not yet checked.
        what
            Beginning of the message of the InputError that invalid settings raise.
        """
        step = parsed(cls, settings, what)
        trust(step.plugins())
        return step

    def plugins(self) -> Iterable[str | None]:
        """Return the names or places (``file.py:Name``) of the plug-ins that the step uses."""
        return ()

    @abstractmethod
    def run(self, *args: Any, **files: Any) -> dict[str, Any]:
        """Do the work of the step: read the input files, and write the output files.

        If the step fails, no output file is written.

        Parameters
        ----------
        args, files
            Paths of input and output files. Classes name and describe them; a parameter of the type
            `Paths` takes several.

        Returns
        -------
        dict[str, Any]
            Facts about the results, which commands print as JSON.
        """

    @classmethod
    def takes_several(cls, key: str) -> bool:
        """Return whether a parameter of `run` takes several files."""
        return get_type_hints(cls.run).get(key) == Paths


STEPS: Registry[type[Step]] = Registry("step", "steps")


@dataclass(frozen=True)
class PlannedStep:
    """A step with its inputs, and with all that decides whether it must run again.

    Parameters
    ----------
    step
        The step with its settings.
    inputs
        Paths of the results of other rules that the step reads, by input name.
    content
        Paths of other files that the step reads, by input name. Their content counts by a digest in
        `also`, and their times do not count.
    code
        Names of the modules, or paths of the user's files, whose code makes the results besides the
        step's own module (`puckbench.steps.fingerprints`).
    also
        Other data on which the results depend, such as digests of files.
    memory_mb, minutes
        Memory and time to request for the step.
    """

    step: Step
    inputs: Inputs
    content: Inputs
    code: tuple[str, ...]
    also: str
    memory_mb: int
    minutes: int

    @cached_property
    def settings(self) -> str:
        """The settings that differ from their defaults, as JSON."""
        return self.step.model_dump_json(exclude_defaults=True)

    @cached_property
    def fingerprint(self) -> str:
        """Text that changes if the code of the step, or the data `also`, change."""
        version = code_version(type(self.step).__module__, *self.code)
        return f"{version} {self.also}".rstrip()

    @cached_property
    def key(self) -> str:
        """Digest of the settings and the fingerprint, by which logs tell how results were made."""
        name = STEPS.name_of(type(self.step))
        content = f"{name}\n{self.settings}\n{self.fingerprint}"
        return hashlib.sha256(content.encode()).hexdigest()[:16]


def planned(
    step: Step,
    inputs: Inputs,
    *code: str,
    content: Inputs | None = None,
    also: object = "",
    memory_mb: int = 1500,
    minutes: int = 10,
) -> PlannedStep:
    """Return a planned step; the parameters are those of `PlannedStep`."""
    places = tuple(str(Path(each).absolute()) if each.endswith(".py") else each for each in code)
    return PlannedStep(step, inputs, content or {}, places, str(also).strip(), memory_mb, minutes)


def words_of(files: Mapping[str, Any], names: Collection[str]) -> str:
    """Return words ``key=FILE ...`` of a command, for those of some files that are named."""
    return shlex.join(f"{name}={files[name]}" for name in names)
