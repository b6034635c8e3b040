import { Button, Checkbox, Table } from "@mantine/core";
import { useDebouncedValue } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { memo, useMemo, useState } from "react";
import { Link, useLocation } from "wouter";
import { Card } from "../../components/Card";
import { RunState, unevaluated } from "../../components/RunState";
import { ValueOrReason } from "../../components/values";
import { dateTime, duration, fixed } from "../../samples/format";
import { runsQuery } from "../../service/api/runs";
import type { Run } from "../../wire/types";
import pageStyles from "../Page.module.css";
import { KeyFigure, RunVerdict } from "./RunDetail";
import { type Filters, NO_FILTERS, RunSearch, whereOf } from "./RunSearch";
import runsStyles from "./Runs.module.css";
import { addressOf, MOST_COMPARED } from "./runAddress";

/** A pageStyles of runs as a table. */

interface RunRowsProps {
  readonly runs: readonly Run[];
  readonly chosen: readonly number[];
  /** No further one can be chosen. */
  readonly full: boolean;
  onChoose(id: number, is: boolean): void;
}

function RunRows({ runs, chosen, full, onChoose }: RunRowsProps) {
  const stations = runs.some(({ station }) => station !== "");
  const plants = commonPlant(runs) === null;
  return (
    <div className={pageStyles.tableScroll}>
      <Table aria-label="Runs" highlightOnHover className={pageStyles.cards ?? ""}>
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
            <Table.Th className={pageStyles.number}>Length</Table.Th>
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
              <Table.Td className={runsStyles.tick ?? ""}>
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
function commonPlant(runs: readonly Run[]): string | null {
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
    <Table.Td className={pageStyles.cardTitle ?? ""}>
      <Link href={`/runs/${run.id}`} style={{ whiteSpace: "nowrap" }}>
        Run {run.id}
      </Link>
    </Table.Td>
    <Table.Td className={runsStyles.kind ?? ""}>{run.title}</Table.Td>
    <Table.Td className={runsStyles.verdict ?? ""}>
      <RunVerdict run={run} />
    </Table.Td>
    <Table.Td className={runsStyles.figure ?? ""}>
      <KeyFigure headline={run.headline} />
    </Table.Td>
    <Table.Td className={runsStyles.when ?? ""}>{dateTime(run.started)}</Table.Td>
    <Table.Td className={pageStyles.number}>{duration(run.duration_s)}</Table.Td>
    <Table.Td className={runsStyles.who ?? ""}>{run.who}</Table.Td>
    {stations && <Table.Td>{run.station}</Table.Td>}
    {plants && <Table.Td>{plantOf(run)}</Table.Td>}
    <Table.Td>
      <RunState state={run.end_state} reason={run.end_reason} unevaluated={unevaluated(run)} />
      <Missing samples={run.missing_samples} />
    </Table.Td>
    <Table.Td>
      <span className={runsStyles.tags}>
        {run.tags.map((tag) => (
          <span key={tag} className={runsStyles.tag}>
            {tag}
          </span>
        ))}
      </span>
    </Table.Td>
    <Table.Td maw={260} className={runsStyles.note ?? ""}>
      <ValueOrReason value={run.note || null} why="no note">
        {(note) => note}
      </ValueOrReason>
    </Table.Td>
  </>
));

/** LocalizedText only where the recording lacks something, or where that is not known. */
function Missing({ samples }: { samples: number | null }) {
  if (samples === 0) return null;
  return (
    <div className={runsStyles.missing}>
      {samples === null ? "missing samples not known" : `${fixed(samples, 0)} samples missing`}
    </div>
  );
}

/** What there will be to look at, and what begins it. */

const WAYS = [
  {
    href: "/operate",
    title: "A session",
    told: "begins with the mode run and ends with it: every sample at 1 kHz, each command and each change of λ at its second.",
  },
  {
    href: "/identify",
    title: "An identification",
    told: "keeps excitation, samples and models, so that a bank made of it leads back to them.",
  },
  {
    href: "/experiments",
    title: "An experiment",
    told: "keeps its references, its criteria and a report that can be checked number by number.",
  },
] as const;

function NoRuns() {
  return (
    <div className={runsStyles.none}>
      <p className={pageStyles.empty}>Nothing recorded yet. A run begins with the mode run.</p>
      <ul className={runsStyles.ways} aria-label="What is recorded">
        {WAYS.map(({ href, title, told }) => (
          <li key={href}>
            <Link href={href}>{title}</Link> {told}
          </li>
        ))}
      </ul>
      <p className={pageStyles.empty}>
        Any run can be replayed in charts and 3D, set beside others, and taken home as CSV, Parquet, MATLAB or
        MCAP.
      </p>
    </div>
  );
}

/** All runs, newest first, a pageStyles at a time; some of them may be chosen and set beside each other. */

const PAGE = 50;

export function RunTable() {
  const [typed, setTyped] = useState("");
  const [filters, setFilters] = useState<Filters>(NO_FILTERS);
  const [offset, setOffset] = useState(0);
  const [chosen, setChosen] = useState<readonly number[]>([]);
  const [, go] = useLocation();
  const [asked] = useDebouncedValue(typed, 250);
  const form = whereOf(filters);
  const where = useMemo(() => [asked, form], [asked, form]);
  const runs = useQuery(runsQuery({ where, limit: PAGE, offset }));
  const total = runs.data?.total ?? 0;
  const rows = runs.data?.runs ?? [];
  const [first, ...others] = chosen;
  const plant = commonPlant(rows);

  return (
    <div className={pageStyles.page}>
      <h1 className={pageStyles.title}>Runs</h1>
      <Card
        title="Recorded runs"
        aside={
          <span className={pageStyles.actions}>
            {plant !== null && <span className={pageStyles.dim}>all on {plant}</span>}
            <Link href="/runs/metrics">Metrics over time</Link>
          </span>
        }
      >
        <RunSearch
          typed={typed}
          filters={filters}
          error={runs.error}
          onType={(text) => {
            setTyped(text);
            setOffset(0);
          }}
          onFilter={(changed) => {
            setFilters(changed);
            setOffset(0);
          }}
        />
        {runs.data === undefined && !runs.error && <p className={pageStyles.empty}>Loading …</p>}
        {runs.data !== undefined &&
          rows.length === 0 &&
          (asked === "" && form === "" ? <NoRuns /> : <p className={pageStyles.empty}>No run matches.</p>)}
        {rows.length > 0 && (
          <RunRows
            runs={rows}
            chosen={chosen}
            full={chosen.length >= MOST_COMPARED}
            onChoose={(id, is) => setChosen(is ? [...chosen, id] : chosen.filter((other) => other !== id))}
          />
        )}
      </Card>
      <div className={pageStyles.actions}>
        <Button
          variant="default"
          disabled={offset === 0}
          onClick={() => setOffset(Math.max(0, offset - PAGE))}
        >
          Newer
        </Button>
        <Button variant="default" disabled={offset + PAGE >= total} onClick={() => setOffset(offset + PAGE)}>
          Older
        </Button>
        <span className={pageStyles.dim}>
          {rows.length === 0 ? "none" : `${offset + 1} to ${offset + rows.length}`} of {total}
        </span>
        <Button
          variant="default"
          disabled={first === undefined || others.length === 0}
          onClick={() => first !== undefined && go(addressOf(first, others))}
        >
          Compare {chosen.length > 0 ? chosen.length : ""} chosen
        </Button>
        {chosen.length > 0 && (
          <Button variant="subtle" onClick={() => setChosen([])}>
            Choose none
          </Button>
        )}
      </div>
    </div>
  );
}
