/** A page of runs as a table. */

import { Checkbox, Table } from "@mantine/core";
import { memo } from "react";
import { Link } from "wouter";
import { Shown } from "../../components/Absent";
import { RunState, unevaluated } from "../../components/RunState";
import { dateTime, duration, fixed } from "../../samples/format";
import type { Run } from "../../wire/types";
import page from "../Page.module.css";
import { KeyFigure, RunVerdict } from "./KeyFigure";
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
  const plants = commonPlant(runs) === null;
  return (
    <div className={page.tableScroll}>
      <Table aria-label="Runs" highlightOnHover className={page.cards ?? ""}>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>
              <span className="visually-hidden">Chosen</span>
            </Table.Th>
            <Table.Th>Run</Table.Th>
            <Table.Th>Kind</Table.Th>
            <Table.Th>Verdict</Table.Th>
            <Table.Th>Key figure</Table.Th>
            <Table.Th>Started</Table.Th>
            <Table.Th className={page.number}>Length</Table.Th>
            <Table.Th>Who</Table.Th>
            {stations && <Table.Th>Station</Table.Th>}
            {plants && <Table.Th>Plant</Table.Th>}
            <Table.Th>End</Table.Th>
            <Table.Th>Tags</Table.Th>
            <Table.Th>Note</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {runs.map((run) => (
            <Table.Tr key={run.id}>
              <Table.Td className={styles.tick ?? ""}>
                <Checkbox
                  size="xs"
                  aria-label={`Choose run ${run.id}`}
                  checked={chosen.includes(run.id)}
                  disabled={full && !chosen.includes(run.id)}
                  onChange={(event) => onChoose(run.id, event.currentTarget.checked)}
                />
              </Table.Td>
              <Cells run={run} stations={stations} plants={plants} />
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </div>
  );
}

/** The plant with its parameters where all these runs were made on the same, else null. */
export function commonPlant(runs: readonly Run[]): string | null {
  const found = new Set(runs.map(plantOf));
  return found.size === 1 ? ([...found][0] as string) : null;
}

function plantOf({ plant, parameters }: Run): string {
  return `${plant}, ${parameters}`;
}

interface CellsProps {
  readonly run: Run;
  readonly stations: boolean;
  readonly plants: boolean;
}

const Cells = memo(({ run, stations, plants }: CellsProps) => (
  <>
    <Table.Td className={page.cardTitle ?? ""}>
      <Link href={`/runs/${run.id}`} style={{ whiteSpace: "nowrap" }}>
        Run {run.id}
      </Link>
    </Table.Td>
    <Table.Td className={styles.kind ?? ""}>{run.title}</Table.Td>
    <Table.Td className={styles.verdict ?? ""}>
      <RunVerdict run={run} />
    </Table.Td>
    <Table.Td className={styles.figure ?? ""}>
      <KeyFigure headline={run.headline} />
    </Table.Td>
    <Table.Td className={styles.when ?? ""}>{dateTime(run.started)}</Table.Td>
    <Table.Td className={page.number}>{duration(run.duration_s)}</Table.Td>
    <Table.Td className={styles.who ?? ""}>{run.who}</Table.Td>
    {stations && <Table.Td>{run.station}</Table.Td>}
    {plants && <Table.Td>{plantOf(run)}</Table.Td>}
    <Table.Td>
      <RunState state={run.end_state} reason={run.end_reason} unevaluated={unevaluated(run)} />
      <Missing samples={run.missing_samples} />
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
    <Table.Td maw={260} className={styles.note ?? ""}>
      <Shown value={run.note || null} why="no note">
        {(note) => note}
      </Shown>
    </Table.Td>
  </>
));

/** LocalizedText only where the recording lacks something, or where that is not known. */
function Missing({ samples }: { samples: number | null }) {
  if (samples === 0) return null;
  return (
    <div className={styles.missing}>
      {samples === null ? "missing samples not known" : `${fixed(samples, 0)} samples missing`}
    </div>
  );
}
