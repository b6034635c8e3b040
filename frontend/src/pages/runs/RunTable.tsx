import { Button, Checkbox, Table } from "@mantine/core";
import { useDebouncedValue } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { memo, useMemo, useState } from "react";
import { Link, useLocation } from "wouter";
import { Card } from "../../components/Card";
import { RunState, unevaluated } from "../../components/RunState";
import { ValueOrReason } from "../../components/values";
import { dateTime, duration, fixed } from "../../samples/format";
import { fillText } from "../../samples/texts";
import { runsQuery } from "../../service/api/runs";
import type { Run } from "../../wire/types";
import pageStyles from "../Page.module.css";
import { KeyFigure, RunVerdict } from "./RunDetail";
import { type Filters, NO_FILTERS, RunSearch, whereOf } from "./RunSearch";
import runsStyles from "./Runs.module.css";
import { addressOf, MOST_COMPARED } from "./runAddress";
import { TEXTS } from "./texts";

/** A page of runs as a table. */

interface RunRowsProps {
  readonly runs: readonly Run[];
  readonly chosen: readonly number[];
  /** No further run can be selected. */
  readonly full: boolean;
  onChoose(id: number, is: boolean): void;
}

function RunRows({ runs, chosen, full, onChoose }: RunRowsProps) {
  const stations = runs.some(({ station }) => station !== "");
  const plants = commonPlant(runs) === null;
  return (
    <div className={pageStyles.tableScroll}>
      <Table aria-label={TEXTS.table} highlightOnHover className={pageStyles.cards ?? ""}>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>
              <span className="visually-hidden">{TEXTS.selected}</span>
            </Table.Th>
            <Table.Th>{TEXTS.runColumn}</Table.Th>
            <Table.Th>{TEXTS.kind}</Table.Th>
            <Table.Th>{TEXTS.verdict}</Table.Th>
            <Table.Th>{TEXTS.headline}</Table.Th>
            <Table.Th>{TEXTS.started}</Table.Th>
            <Table.Th className={pageStyles.number}>{TEXTS.duration}</Table.Th>
            <Table.Th>{TEXTS.person}</Table.Th>
            {stations && <Table.Th>{TEXTS.station}</Table.Th>}
            {plants && <Table.Th>{TEXTS.plant}</Table.Th>}
            <Table.Th>{TEXTS.status}</Table.Th>
            <Table.Th>{TEXTS.tags}</Table.Th>
            <Table.Th>{TEXTS.note}</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {runs.map((run) => (
            <Table.Tr key={run.id}>
              <Table.Td className={runsStyles.tick ?? ""}>
                <Checkbox
                  size="xs"
                  aria-label={fillText(TEXTS.selectRun, { run: run.id })}
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

/** Returns the plant and parameters that all these runs share; null if they differ. */
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
        {fillText(TEXTS.run, { run: run.id })}
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
      <ValueOrReason value={run.note || null} why={TEXTS.noNote}>
        {(note) => note}
      </ValueOrReason>
    </Table.Td>
  </>
));

/** Shows a text only if samples are missing or their number is unknown. */
function Missing({ samples }: { samples: number | null }) {
  if (samples === 0) return null;
  return (
    <div className={runsStyles.missing}>
      {samples === null
        ? TEXTS.missingUnknown
        : fillText(TEXTS.samplesMissing, { samples: fixed(samples, 0) })}
    </div>
  );
}

/** Text in place of an empty list: which actions record runs. */

const SOURCES = [
  {
    href: "/operate",
    title: TEXTS.session,
    description: TEXTS.sessionRecords,
  },
  {
    href: "/identify",
    title: TEXTS.identification,
    description: TEXTS.identificationRecords,
  },
  {
    href: "/experiments",
    title: TEXTS.experiment,
    description: TEXTS.experimentRecords,
  },
] as const;

function NoRuns() {
  return (
    <div className={runsStyles.none}>
      <p className={pageStyles.empty}>{TEXTS.noRuns}</p>
      <ul className={runsStyles.sources} aria-label={TEXTS.recordedKinds}>
        {SOURCES.map(({ href, title, description }) => (
          <li key={href}>
            <Link href={href}>{title}</Link> {description}
          </li>
        ))}
      </ul>
      <p className={pageStyles.empty}>{TEXTS.useOfRuns}</p>
    </div>
  );
}

/** Page with all runs, newest first, in pages; selected runs can be compared. */

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
      <h1 className={pageStyles.title}>{TEXTS.runs}</h1>
      <Card
        title={TEXTS.recordedRuns}
        aside={
          <span className={pageStyles.actions}>
            {plant !== null && (
              <span className={pageStyles.dim}>{fillText(TEXTS.plantOfAll, { plant })}</span>
            )}
            <Link href="/runs/metrics">{TEXTS.metricsOverTime}</Link>
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
        {runs.data === undefined && !runs.error && <p className={pageStyles.empty}>{TEXTS.loading}</p>}
        {runs.data !== undefined &&
          rows.length === 0 &&
          (asked === "" && form === "" ? <NoRuns /> : <p className={pageStyles.empty}>{TEXTS.noMatch}</p>)}
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
          {TEXTS.newer}
        </Button>
        <Button variant="default" disabled={offset + PAGE >= total} onClick={() => setOffset(offset + PAGE)}>
          {TEXTS.older}
        </Button>
        <span className={pageStyles.dim}>
          {rows.length === 0
            ? TEXTS.shownNone
            : fillText(TEXTS.shownRange, { first: offset + 1, last: offset + rows.length, total })}
        </span>
        <Button
          variant="default"
          disabled={first === undefined || others.length === 0}
          onClick={() => first !== undefined && go(addressOf(first, others))}
        >
          {chosen.length > 0 ? fillText(TEXTS.compareSelected, { count: chosen.length }) : TEXTS.compare}
        </Button>
        {chosen.length > 0 && (
          <Button variant="subtle" onClick={() => setChosen([])}>
            {TEXTS.clearSelection}
          </Button>
        )}
      </div>
    </div>
  );
}
