"""``sinew db recordings``."""

from typing import Annotated

import typer

from backend.cli.ordering import current_user
from backend.cli.output import AsJson, fail, out, print_json, print_table
from backend.cli.place import DataFolder, database_of, settings_with


def recordings(
    delete: Annotated[
        list[int] | None,
        typer.Option("--delete", help="Delete the samples of this run of the list; once for each run."),
    ] = None,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Say how much recordings take, and list the runs whose samples may go. Deletes only runs named one by one."""
    from backend.recording.retention import NotRemovableError, Rule, overview, remove

    settings = settings_with(data=data)
    rule = Rule(round(settings.recordings_GB * 1e9), settings.recordings_keep_days)
    with database_of(settings) as database:
        try:
            found = remove(database, rule, delete, current_user()) if delete else overview(database, rule)
        except NotRemovableError as error:
            fail(str(error), status=2)
    if as_json:
        may_go = [{"run": run.run_id, "started": run.started_at, "size_bytes": run.size_bytes} for run in found.may_go]
        print_json({"total_bytes": found.total_bytes, "limit_bytes": rule.max_bytes, "may_go": may_go})
        return
    total, limit = f"{found.total_bytes / 1e9:.3f} GB", f"{settings.recordings_GB:g} GB"
    out.print(found.says or f"recordings take {total}, limit {limit}: nothing has to go", highlight=False, markup=False)
    if found.may_go:
        rows = [
            (
                run.run_id,
                f"{run.started_at:%Y-%m-%d %H:%M}",
                run.kind,
                run.who,
                f"{run.size_bytes / 1e6:.1f} MB",
                run.note,
            )
            for run in found.may_go
        ]
        print_table(("run", "started (UTC)", "kind", "by", "samples", "note"), rows)
        named = " ".join(f"--delete {run.run_id}" for run in found.may_go)
        out.print(f"to delete these samples: sinew db recordings {named}", highlight=False, markup=False)
