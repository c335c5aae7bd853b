"""The fleet as text, for people."""

from __future__ import annotations

from service.fleet.census import Census


def print_status(found: Census) -> None:
    """A line for each partition, and what calls for attention."""
    from rich.console import Console
    from rich.table import Table

    table = Table("partition", "host", "process", "since", "assets", "windows waiting", "state", box=None)
    for row in found.partitions:
        state = "served" if row["served"] else "not served"
        if row["served"] and row["not_ready"]:
            state = f"served, takes no frames: {row['not_ready']}"
        since = (row["since"] or "")[:19].replace("T", " ")
        shown = (row["node"] or "", row["worker"] or "", since, row["assets"], row["waiting"], state)
        table.add_row(str(row["partition"]), *map(str, shown))
    console = Console(width=None)
    console.print(table)
    levels = ", ".join(f"{count} {level.replace('_', ' ')}" for level, count in sorted(found.assets.items()))
    console.print(f"assets: {sum(found.assets.values())}" + (f" ({levels})" if levels else ""))
    for partition in found.crowded:
        console.print(f"partition {partition} has more assets than are recovered in time: use more partitions")
