/** A page of runs as a table. */

import { Checkbox, Table } from "@mantine/core";
import { memo } from "react";
import { Link } from "wouter";
import { Shown } from "../../components/Absent";
import { RunState, unevaluated } from "../../components/RunState";
import { dateTime, duration, fixed } from "../../samples/format";
import type { Run } from "../../wire/types";
import page from "../Page.module.css";
import styles from "./Runs.module.css";

interface RunRowsProps {
  readonly runs: readonly Run[];
  readonly chosen: readonly number[];
  /** No further one can be chosen. */
  readonly full: boolean;
  onChoose(id: number, is: boolean): void;
}

export function RunRows({ runs, chosen, full, onChoose }: RunRowsProps) {
  const stations = runs.some(({ station }) => station !== "");
  return (
    <div className={page.tableScroll}>
      <Table aria-label="Runs" highlightOnHover>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>
              <span className="visually-hidden">Chosen</span>
            </Table.Th>
            <Table.Th>Run</Table.Th>
            <Table.Th>Kind</Table.Th>
            <Table.Th>Started</Table.Th>
            <Table.Th className={page.number}>Length</Table.Th>
            <Table.Th>Who</Table.Th>
            {stations && <Table.Th>Station</Table.Th>}
            <Table.Th>Plant</Table.Th>
            <Table.Th>End</Table.Th>
            <Table.Th className={page.number}>Samples missing</Table.Th>
            <Table.Th>Tags</Table.Th>
            <Table.Th>Note</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {runs.map((run) => (
            <Table.Tr key={run.id}>
              <Table.Td>
                <Checkbox
                  size="xs"
                  aria-label={`Choose run ${run.id}`}
                  checked={chosen.includes(run.id)}
                  disabled={full && !chosen.includes(run.id)}
                  onChange={(event) => onChoose(run.id, event.currentTarget.checked)}
                />
              </Table.Td>
              <Cells run={run} stations={stations} />
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </div>
  );
}

const Cells = memo(({ run, stations }: { run: Run; stations: boolean }) => (
  <>
    <Table.Td>
      <Link href={`/runs/${run.id}`} style={{ whiteSpace: "nowrap" }}>
        Run {run.id}
      </Link>
    </Table.Td>
    <Table.Td>{run.title}</Table.Td>
    <Table.Td style={{ whiteSpace: "nowrap" }}>{dateTime(run.started)}</Table.Td>
    <Table.Td className={page.number}>{duration(run.duration_s)}</Table.Td>
    <Table.Td>{run.who}</Table.Td>
    {stations && <Table.Td>{run.station}</Table.Td>}
    <Table.Td>
      {run.plant}, {run.parameters}
    </Table.Td>
    <Table.Td>
      <RunState state={run.end_state} reason={run.end_reason} unevaluated={unevaluated(run)} />
    </Table.Td>
    <Table.Td className={page.number}>
      {run.missing_samples === null ? "not known" : fixed(run.missing_samples, 0)}
    </Table.Td>
    <Table.Td>
      <span className={styles.tags}>
        {run.tags.map((tag) => (
          <span key={tag} className={styles.tag}>
            {tag}
          </span>
        ))}
      </span>
    </Table.Td>
    <Table.Td maw={260}>
      <Shown value={run.note || null} why="no note">
        {(note) => note}
      </Shown>
    </Table.Td>
  </>
));
