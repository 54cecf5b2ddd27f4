"""Ready declarations of well-known networks. The networks themselves are had from their official pages."""

from dataclasses import replace
from functools import cache
from importlib import resources
from pathlib import Path

from core_solver.errors import ModelError
from core_solver.perception.networks.spec import NetworkSpec, read_spec
from core_solver.perception.store import ModelStore

_FOLDER = Path(str(resources.files("core_solver.perception.networks"))) / "catalogue"
STORE_TASK = "networks"


@cache
def known_networks() -> tuple[NetworkSpec, ...]:
    """Every declaration of the catalogue, by name."""
    return tuple(read_spec(path) for path in sorted(_FOLDER.glob("*.toml")))


def read_declaration(named: str | Path, store: ModelStore) -> NetworkSpec:
    """A user's declaration, or the catalogue's of that name with its network from the store.

    Raises:
        ModelError: no such file and no such entry, or the entry's network has not been added yet.
    """
    entry = next((spec for spec in known_networks() if spec.toml.stem == str(named)), None)
    if entry is None:
        if not Path(named).is_file():
            names = ", ".join(spec.toml.stem for spec in known_networks())
            raise ModelError(f"there is no network declaration {named}: give a TOML file, or one of {names}")
        return read_spec(Path(named))
    return replace(entry, file=network_file(entry, store))


def network_file(entry: NetworkSpec, store: ModelStore) -> Path:
    """Where the store keeps the network of a catalogue entry; the few that it can fetch are fetched.

    Raises:
        ModelError: it has not been added yet, or cannot be fetched.
    """
    if fetchable(entry, store):
        return store.require(entry.toml.stem)
    for file in store.files(STORE_TASK):
        if file.name == entry.file.name:
            return file
    raise ModelError(
        f"the network {entry.file.name} is not here: get it from {entry.about.page} and run "
        f"'scene-aware-mocap models add FILE --task {STORE_TASK} --name {entry.file.stem}'"
    )


def fetchable(entry: NetworkSpec, store: ModelStore) -> bool:
    """Whether the store itself knows where to get the network of a catalogue entry."""
    return any(known.name == entry.toml.stem for known in store.entries())
