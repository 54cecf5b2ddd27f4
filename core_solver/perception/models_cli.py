"""`scene-aware-mocap models list | fetch | add | path`: the model store from the command line.

`core_solver.cli` calls `add_parser` and then the handler that the parsed arguments carry as `run`. Errors leave as
`UserError`; the caller prints them on one line.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from core_solver.perception.store import MODELS_DIR_VARIABLE, ModelStore, catalogue

if TYPE_CHECKING:
    import argparse

    from core_solver.perception.store import ModelEntry


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the `models` command and its four actions."""
    models = subparsers.add_parser("models", help="list, fetch and add networks and body models")
    actions = models.add_subparsers(dest="action", required=True)

    listing = actions.add_parser("list", help="what there is, and what of it is on this computer")
    listing.set_defaults(run=list_models)

    fetch = actions.add_parser("fetch", help="fetch the default models, or those named")
    fetch.add_argument("names", nargs="*", metavar="NAME", help="models to fetch; the defaults when none is named")
    fetch.add_argument("--all", action="store_true", help="everything, also what is fetched only on request")
    fetch.add_argument("--offline", action="store_true", help="only check that they are here")
    fetch.set_defaults(run=fetch_models)

    add = actions.add_parser("add", help="add a model of your own")
    add.add_argument("file", type=Path, metavar="FILE")
    add.add_argument("--task", required=True, choices=[task.name for task in catalogue()[0]])
    add.add_argument("--name", help="what to call it (default: the file's name)")
    add.set_defaults(run=add_model)

    path = actions.add_parser("path", help="where the models, or one of them, lie on this computer")
    path.add_argument("name", nargs="?", metavar="NAME")
    path.set_defaults(run=show_path)

    for action in (listing, fetch, add, path):
        action.add_argument(
            "--models-dir",
            type=Path,
            metavar="DIR",
            help=f"where models are kept (default: {MODELS_DIR_VARIABLE}, else the user's cache directory)",
        )


def say(line: str) -> None:
    """One line to the user."""
    sys.stdout.write(line + "\n")


def list_models(arguments: argparse.Namespace) -> int:
    """Print every entry with its state, then the user's own files and the ready declarations of networks."""
    store = ModelStore(arguments.models_dir)
    say(f"models in {store.models_dir}")
    for entry in store.entries():
        size = f"{entry.package.size / 1e6:.0f} MB to fetch"
        say(f"  {entry.name:36}{entry.task:12}{state(store, entry):20}{size:18}{entry.licence}")
    fetched = {store.path(entry.name) for entry in store.entries()}
    for task in store.tasks:
        for file in store.files(task.name):
            if file not in fetched:
                say(f"  {file.name:36}{task.name:12}added by you")
    list_networks(store)
    return 0


def list_networks(store: ModelStore) -> None:
    """Print the ready declarations of networks: which are here, where they come from, what their licences allow."""
    from core_solver.perception.networks.catalogue import fetchable, known_networks  # noqa: PLC0415 - slow to load

    here = {file.name for file in store.files("networks")}
    say("ready for 'solve --network NAME'; what is to be added: get the file, then 'models add FILE --task networks'")
    for spec in known_networks():
        if fetchable(spec, store):
            place = state(store, store.entry(spec.toml.stem))
        else:
            place = "here" if spec.file.name in here else "to be added"
        use = "" if spec.about.commercial else "not commercial: "
        data = f" ({spec.about.data})" if spec.about.data else ""
        say(f"  {spec.toml.stem:36}{spec.kind.task:12}{place:20}{use}{spec.about.licence}{data}  {spec.about.page}")


def state(store: ModelStore, entry: ModelEntry) -> str:
    """Whether an entry is here, and if not, whether it comes by itself."""
    if store.path(entry.name) is not None:
        return "here"
    return "fetched when used" if entry.default else "on request"


def fetch_models(arguments: argparse.Namespace) -> int:
    """Fetch the named models, the defaults, or all; print where each lies."""
    store = ModelStore(arguments.models_dir, offline=arguments.offline)
    chosen = arguments.names or [entry.name for entry in store.entries() if entry.default or arguments.all]
    for entry in [store.entry(name) for name in chosen]:  # wrong names are refused before anything is fetched
        say(f"{entry.name}: {store.fetch(entry.name)}")
    return 0


def add_model(arguments: argparse.Namespace) -> int:
    """Copy a user's file into the store."""
    store = ModelStore(arguments.models_dir)
    say(f"added {store.add(arguments.file, arguments.name, arguments.task)}")
    return 0


def show_path(arguments: argparse.Namespace) -> int:
    """Print the store's directory or a model's file; 1 when that model is not here."""
    store = ModelStore(arguments.models_dir)
    if arguments.name is None:
        say(str(store.models_dir))
        return 0
    path = store.path(arguments.name)
    if path is None:
        say(f"{arguments.name} is not here yet: run 'scene-aware-mocap models fetch {arguments.name}'")
        return 1
    say(str(path))
    return 0
