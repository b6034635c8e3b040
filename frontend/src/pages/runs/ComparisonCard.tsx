import { ActionIcon, Button, Group, NativeSelect, Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useMemo } from "react";
import { TbX } from "react-icons/tb";
import { Link, useLocation } from "wouter";
import { Card } from "../../components/Card";
import { SeriesReports } from "../../components/Downloads";
import { Explained } from "../../components/Explained";
import { DebouncedNumberField } from "../../components/fields";
import { Unit } from "../../components/values";
import { dateTime, fixed, measured, significant } from "../../samples/format";
import { type AngleUnit, localizeText, readingOf } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { useAngleUnit } from "../../service/api/preferences";
import { type ComparisonAsked, comparisonFile, comparisonQuery, runsQuery } from "../../service/api/runs";
import { figureEntry } from "../../service/glossary";
import type { ComparedMetric, Run, RunComparison } from "../../wire/types";
import { Reason, SEEN } from "../experiments/ExperimentRuns";
import { NAMES } from "../log/LogRows";
import pageStyles from "../Page.module.css";
import { DifferencesCard, DifferingSettings } from "./DifferencesCard";
import { type Placed, RunCharts } from "./RunCharts";
import runsStyles from "./Runs.module.css";
import {
  ALIGN_BY,
  type AlignBy,
  addressOf,
  askedOf,
  type Compared,
  EVENT_KINDS,
  type EventKind,
  MOST_COMPARED,
  MOST_NUMBER,
  STEP_SIGNALS,
  type StepSignal,
  textOf,
} from "./runAddress";
import { TEXTS } from "./texts";

/** Card with the metrics of several runs in columns, and the differences to the reference run. */

interface ComparisonCardProps {
  readonly asked: ComparisonAsked;
  /** Signal of the exported curves. */
  readonly signal: string;
  /** Last comparison from the service, possibly with another reference. */
  readonly comparison: RunComparison | undefined;
  readonly error: Error | null;
}

export function ComparisonCard({ asked, signal, comparison: data, error }: ComparisonCardProps) {
  const { reference } = asked;
  const angles = useAngleUnit();
  return (
    <Card title={TEXTS.comparison} aside={<Files asked={asked} signal={signal} />}>
      {data === undefined ? (
        <p className={pageStyles.empty}>{error?.message ?? TEXTS.loading}</p>
      ) : (
        <div className={runsStyles.answer} aria-busy={data.reference !== reference}>
          <p className={pageStyles.dim}>{fillText(TEXTS.differenceBelow, { run: reference })}</p>
          <div className={pageStyles.tableScroll}>
            <Table aria-label={TEXTS.comparison} verticalSpacing={4}>
              <Table.Thead>
                <Table.Tr>
                  <Table.Th>{TEXTS.metric}</Table.Th>
                  {data.runs.map((run) => (
                    <Table.Th
                      key={run.id}
                      className={pageStyles.number}
                      title={localizeText(run.verdict, angles)}
                    >
                      <Link href={`/runs/${run.id}`}>{fillText(TEXTS.run, { run: run.id })}</Link>
                      <div className={pageStyles.dim}>{run.title}</div>
                      <div className={pageStyles.dim}>{dateTime(run.started)}</div>
                    </Table.Th>
                  ))}
                  <Table.Th>{TEXTS.unit}</Table.Th>
                </Table.Tr>
              </Table.Thead>
              <Table.Tbody>
                {data.metrics.map((metric) => (
                  <Table.Tr key={metric.name}>
                    <Table.Td>
                      <Explained of={figureEntry(metric)}>{metric.label}</Explained>
                    </Table.Td>
                    {data.runs.map((run, index) => (
                      <Value
                        key={run.id}
                        metric={metric}
                        index={index}
                        angles={angles}
                        compared={data.reference === reference}
                      />
                    ))}
                    <Table.Td>
                      <Unit unit={metric.unit} />
                    </Table.Td>
                  </Table.Tr>
                ))}
              </Table.Tbody>
            </Table>
          </div>
          {data.metrics.length === 0 && <p className={pageStyles.empty}>{TEXTS.noResults}</p>}
          <DifferingSettings comparison={data} />
        </div>
      )}
    </Card>
  );
}

/** Buttons for a report of all compared runs and for the comparison as CSV files. */
function Files({ asked, signal }: { asked: ComparisonAsked; signal: string }) {
  const files = [
    { label: TEXTS.tableFile, href: comparisonFile("table", asked, signal) },
    { label: fillText(TEXTS.curvesFile, { signal }), href: comparisonFile("curves", asked, signal) },
  ];
  return (
    <Group gap="xs">
      <SeriesReports runs={asked.run} />
      {files.map(({ label, href }) => (
        <Button key={label} component="a" href={href} download variant="default" size="xs">
          {label}
        </Button>
      ))}
    </Group>
  );
}

interface ValueProps {
  readonly metric: ComparedMetric;
  readonly index: number;
  readonly angles: AngleUnit;
  /** Whether the differences are to the selected reference. */
  readonly compared: boolean;
}

function Value({ metric, index, angles, compared }: ValueProps) {
  const found = metric.values[index];
  if (found === undefined) return <Table.Td />;
  const { factor } = readingOf(metric.unit, angles);
  const value = found.value === null ? null : found.value * factor;
  return (
    <Table.Td className={pageStyles.number}>
      {measured(value, 4)}
      {compared && (
        <div className={pageStyles.dim}>{difference(found.difference, found.percent, factor)}</div>
      )}
      <Reason text={found.reason} seen={value === null ? undefined : SEEN["<"]} />
    </Table.Td>
  );
}

/** Smaller differences are rounding errors [%]. */
const SAME_PERCENT = 1e-9;

/** Returns a text like "+0.5 (+12 %)"; "" if both values are equal or one is missing. */
function difference(value: number | null, percent: number | null, factor: number): string {
  if (value === null || value === 0 || Math.abs(percent ?? 100) < SAME_PERCENT) return "";
  const sign = value > 0 ? "+" : "";
  const relative = percent === null ? "" : ` (${sign}${significant(percent, 3)} %)`;
  return `${sign}${significant(value * factor, 4)}${relative}`;
}

/** Bar that selects the reference run and the event at which the runs are aligned. */

const ALIGNMENTS: Readonly<Record<AlignBy, string>> = {
  begin: TEXTS.alignBegin,
  step: TEXTS.alignStep,
  event: TEXTS.alignEvent,
};
const STEPS: Readonly<Record<StepSignal, string>> = {
  q_ref: TEXTS.stepInQ,
  S_ref: TEXTS.stepInS,
  F_push: TEXTS.stepInPush,
};

interface AlignmentBarProps {
  readonly asked: ComparisonAsked;
  onChange(to: Partial<Compared>): void;
}

export function AlignmentBar({ asked, onChange }: AlignmentBarProps) {
  const { run, reference, by, step, event, number } = asked;
  return (
    <div className={pageStyles.actions}>
      <NativeSelect
        aria-label={TEXTS.reference}
        value={String(reference)}
        data={run.map((id) => ({ value: String(id), label: fillText(TEXTS.referenceRun, { run: id }) }))}
        onChange={({ currentTarget: { value } }) =>
          onChange({ reference: Number(value) === run[0] ? null : Number(value) })
        }
      />
      <NativeSelect
        aria-label={TEXTS.alignment}
        value={by}
        data={ALIGN_BY.map((value) => ({ value, label: ALIGNMENTS[value] }))}
        onChange={({ currentTarget: { value } }) => onChange({ by: value as AlignBy, number: 1 })}
      />
      {by === "step" && (
        <NativeSelect
          aria-label={TEXTS.stepSignal}
          value={step}
          data={STEP_SIGNALS.map((value) => ({ value, label: STEPS[value] }))}
          onChange={({ currentTarget: { value } }) => onChange({ step: value as StepSignal })}
        />
      )}
      {by === "event" && (
        <NativeSelect
          aria-label={TEXTS.eventKind}
          value={event}
          data={EVENT_KINDS.map((value) => ({ value, label: NAMES[value] }))}
          onChange={({ currentTarget: { value } }) => onChange({ event: value as EventKind })}
        />
      )}
      {by !== "begin" && (
        <DebouncedNumberField
          label={by === "step" ? TEXTS.stepNumber : TEXTS.eventNumber}
          before={TEXTS.numberShort}
          value={number}
          fits={(found) =>
            Number.isInteger(found) && found >= 1 && found <= MOST_NUMBER
              ? ""
              : fillText(TEXTS.wholeNumber, { most: MOST_NUMBER })
          }
          onChange={(found) => onChange({ number: found ?? 1 })}
        />
      )}
    </div>
  );
}

/** Control that adds runs to the comparison and removes them. */

const OFFERED = 100;

interface CompareWithProps {
  readonly run: Run;
  readonly others: readonly number[];
  /** Settings of the comparison as in the address of the page. */
  readonly how?: string;
}

export function CompareWith({ run, others, how = "" }: CompareWithProps) {
  const [, go] = useLocation();
  const runs = useQuery(runsQuery({ limit: OFFERED, offset: 0 }));
  const offered = (runs.data?.runs ?? []).filter(
    ({ id, samples }) => id !== run.id && samples > 0 && !others.includes(id),
  );
  // runs with the same title first, because these are compared most often
  const sorted = [...offered].sort((a, b) => Number(b.title === run.title) - Number(a.title === run.title));
  return (
    <div className={pageStyles.actions}>
      {others.map((id) => (
        <span key={id}>
          {fillText(TEXTS.run, { run: id })}
          <ActionIcon
            size={18}
            variant="subtle"
            color="gray"
            aria-label={fillText(TEXTS.removeRun, { run: id })}
            onClick={() =>
              go(
                addressOf(
                  run.id,
                  others.filter((other) => other !== id),
                  null,
                  how,
                ),
              )
            }
          >
            <TbX size={12} />
          </ActionIcon>
        </span>
      ))}
      <NativeSelect
        aria-label={TEXTS.compareWith}
        value=""
        disabled={others.length >= MOST_COMPARED - 1}
        onChange={(event) => go(addressOf(run.id, [...others, Number(event.currentTarget.value)], null, how))}
        data={[
          { value: "", label: others.length === 0 ? TEXTS.chooseRun : TEXTS.addRun },
          ...sorted.map(({ id, title, started }) => ({
            value: String(id),
            label: fillText(TEXTS.runOption, { run: id, title, started: dateTime(started) }),
          })),
        ]}
      />
    </div>
  );
}

/** Comparison of runs: curves on one time axis, differences to the reference, and metrics. */

interface ComparedRunsProps {
  readonly run: Run;
  /** Must be the same array while its elements are equal. */
  readonly others: readonly number[];
  readonly compared: Compared;
}

export function ComparedRuns({ run, others, compared }: ComparedRunsProps) {
  const [, go] = useLocation();
  const asked = useMemo(() => askedOf([run.id, ...others], compared), [run.id, others, compared]);
  const { data, error, isPlaceholderData } = useQuery(comparisonQuery(asked));
  const comparison = isPlaceholderData ? undefined : data;
  const placed = usePlaced(asked, comparison);
  const drawn = useMemo(() => asked.run.filter((id) => placed?.offsets.has(id)), [asked, placed]);
  const change = (to: Partial<Compared>) =>
    go(addressOf(run.id, others, null, textOf({ ...compared, ...to })), { replace: true });
  return (
    <>
      <Card title={TEXTS.curves} aside={<CompareWith run={run} others={others} how={textOf(compared)} />}>
        <AlignmentBar asked={asked} onChange={change} />
        <p className={runsStyles.placed} aria-live="polite">
          {comparison === undefined ? (
            (error?.message ?? TEXTS.aligning)
          ) : (
            <Placing comparison={comparison} />
          )}
        </p>
        <div className={pageStyles.charts}>
          {placed === undefined ? (
            <p className={pageStyles.empty}>{error === null ? TEXTS.loading : TEXTS.noCurves}</p>
          ) : (
            <RunCharts run={run.id} others={others} placed={placed} />
          )}
        </div>
      </Card>
      <DifferencesCard
        asked={asked}
        drawn={drawn}
        signal={compared.signal}
        band={compared.band}
        onChange={change}
      />
      <ComparisonCard asked={asked} signal={compared.signal} comparison={data} error={error} />
    </>
  );
}

/** Returns the time offsets of the runs; alignment at the start does not wait for the comparison. */
function usePlaced(asked: ComparisonAsked, comparison: RunComparison | undefined): Placed | undefined {
  return useMemo(() => {
    const { reference, by, run } = asked;
    if (by === "begin") return { reference, offsets: new Map(run.map((id) => [id, 0])) };
    if (comparison === undefined) return undefined;
    const found = comparison.runs.flatMap(({ id, offset_s }): [number, number][] =>
      offset_s === null ? [] : [[id, offset_s]],
    );
    return { reference, offsets: new Map(found) };
  }, [asked, comparison]);
}

/** Text with the time offset of each run, or the reason why a run is not aligned. */
function Placing({ comparison }: { comparison: RunComparison }) {
  const absent = comparison.runs.filter(({ not_aligned }) => not_aligned !== "");
  const shifted = comparison.runs.filter(
    ({ id, offset_s }) => id !== comparison.reference && offset_s !== null,
  );
  return (
    <>
      {fillText(TEXTS.timeBase, { run: comparison.reference })}
      {shifted.map(({ id, offset_s }) => (
        <span key={id}>{fillText(TEXTS.offset, { run: id, offset: signed(offset_s as number) })}</span>
      ))}
      {absent.map(({ id, not_aligned }) => (
        <strong key={id} role="alert" className={runsStyles.absent}>
          {fillText(TEXTS.notAligned, { reason: not_aligned })}
        </strong>
      ))}
    </>
  );
}

function signed(value: number): string {
  if (value === 0) return "0";
  return value > 0 ? `+${fixed(value, 3)}` : fixed(value, 3);
}
