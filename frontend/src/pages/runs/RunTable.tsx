/** All runs, newest first. */

import { Button, NativeSelect, Table, TextInput } from "@mantine/core";
import { useDebouncedValue } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { TbSearch } from "react-icons/tb";
import { Link } from "wouter";
import { Shown } from "../../components/Absent";
import { Card } from "../../components/Card";
import { RunState, unevaluated } from "../../components/RunState";
import { dateTime, duration, fixed } from "../../samples/format";
import { runsQuery } from "../../service/queries";
import type { Run } from "../../wire/types";
import page from "../Page.module.css";

const PAGE = 50;
const KINDS = [
  { value: "", label: "All kinds" },
  { value: "session", label: "session" },
  { value: "actuator_identification", label: "actuator identification" },
  { value: "motor_identification", label: "motor identification" },
  { value: "spring_identification", label: "spring identification" },
  { value: "tracking", label: "tracking" },
  { value: "compliance", label: "compliance" },
  { value: "robustness", label: "robustness" },
  { value: "sequence", label: "own sequence" },
];

export function RunTable() {
  const [search, setSearch] = useState("");
  const [kind, setKind] = useState("");
  const [offset, setOffset] = useState(0);
  const [asked] = useDebouncedValue(search, 250);
  const runs = useQuery(runsQuery({ kind, search: asked.trim(), limit: PAGE, offset }));
  const total = runs.data?.total ?? 0;
  const rows = runs.data?.runs ?? [];

  return (
    <div className={page.page}>
      <h1 className={page.title}>Runs</h1>
      <Card
        title="Runs"
        aside={
          <div className={page.actions}>
            <NativeSelect
              aria-label="Kind"
              data={KINDS}
              value={kind}
              onChange={(event) => {
                setKind(event.currentTarget.value);
                setOffset(0);
              }}
            />
            <TextInput
              type="search"
              aria-label="Search runs"
              placeholder="Search notes, persons, kinds"
              leftSection={<TbSearch size={14} />}
              value={search}
              w={240}
              onChange={(event) => {
                setSearch(event.currentTarget.value);
                setOffset(0);
              }}
            />
          </div>
        }
      >
        {runs.data === undefined && <p className={page.empty}>{runs.error?.message ?? "Loading …"}</p>}
        {runs.data !== undefined && rows.length === 0 && (
          <p className={page.empty}>
            {asked === "" && kind === ""
              ? "Nothing recorded yet. A run begins with the mode run."
              : "No run matches."}
          </p>
        )}
        {rows.length > 0 && <Rows runs={rows} />}
      </Card>
      {total > PAGE && (
        <div className={page.actions}>
          <Button
            variant="default"
            disabled={offset === 0}
            onClick={() => setOffset(Math.max(0, offset - PAGE))}
          >
            Newer
          </Button>
          <Button
            variant="default"
            disabled={offset + PAGE >= total}
            onClick={() => setOffset(offset + PAGE)}
          >
            Older
          </Button>
          <span className={page.dim}>
            {offset + 1} to {offset + rows.length} of {total}
          </span>
        </div>
      )}
    </div>
  );
}

function Rows({ runs }: { runs: readonly Run[] }) {
  return (
    <div className={page.tableScroll}>
      <Table aria-label="Runs" highlightOnHover>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>Run</Table.Th>
            <Table.Th>Kind</Table.Th>
            <Table.Th>Started</Table.Th>
            <Table.Th className={page.number}>Length</Table.Th>
            <Table.Th>Who</Table.Th>
            <Table.Th>Plant</Table.Th>
            <Table.Th>End</Table.Th>
            <Table.Th className={page.number}>Samples missing</Table.Th>
            <Table.Th>Note</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {runs.map((run) => (
            <Table.Tr key={run.id}>
              <Table.Td>
                <Link href={`/runs/${run.id}`}>Run {run.id}</Link>
              </Table.Td>
              <Table.Td>{run.title}</Table.Td>
              <Table.Td style={{ whiteSpace: "nowrap" }}>{dateTime(run.started)}</Table.Td>
              <Table.Td className={page.number}>{duration(run.duration_s)}</Table.Td>
              <Table.Td>{run.who}</Table.Td>
              <Table.Td>
                {run.plant}, {run.parameters}
              </Table.Td>
              <Table.Td>
                <RunState state={run.end_state} reason={run.end_reason} unevaluated={unevaluated(run)} />
              </Table.Td>
              <Table.Td className={page.number}>{fixed(run.missing_samples, 0)}</Table.Td>
              <Table.Td maw={260}>
                <Shown value={run.note || null} why="no note">
                  {(note) => note}
                </Shown>
              </Table.Td>
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </div>
  );
}
