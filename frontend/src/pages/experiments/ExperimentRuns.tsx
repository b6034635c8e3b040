import { Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { Downloads } from "../../components/Downloads";
import { Explained } from "../../components/Explained";
import { Outcome, RunState, unevaluated, Verdict } from "../../components/RunState";
import { LocalizedText, Unit } from "../../components/values";
import { useLive } from "../../live/react";
import { dateTime, duration, measured, NOT_MEASURED } from "../../samples/format";
import { type AngleUnit, formatWithUnit, localizeText, readingNear, readingOf } from "../../samples/quantity";
import { experimentQuery } from "../../service/api/experiments";
import { isRunning } from "../../service/api/polling";
import { useAngleUnit } from "../../service/api/preferences";
import { figureEntry } from "../../service/glossary";
import type { Criterion, Experiment, Metric, Run } from "../../wire/types";
import pageStyles from "../Page.module.css";
import { RunCharts } from "../runs/RunCharts";
import { RunSummary } from "./ExperimentForm";

/** Experiments done before. */

export function ExperimentRuns({
  runs,
  selected,
}: {
  runs: readonly Run[] | undefined;
  selected: number | undefined;
}) {
  return (
    <Card title="Earlier experiments">
      {(runs === undefined || runs.length === 0) && (
        <p className={pageStyles.empty}>{runs === undefined ? "Loading …" : "No experiment yet."}</p>
      )}
      {runs !== undefined && runs.length > 0 && (
        <div className={pageStyles.tableScroll}>
          <Table aria-label="Earlier experiments" highlightOnHover>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>Run</Table.Th>
                <Table.Th>Kind</Table.Th>
                <Table.Th>When</Table.Th>
                <Table.Th className={pageStyles.number}>Length</Table.Th>
                <Table.Th>Who</Table.Th>
                <Table.Th>End</Table.Th>
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {runs.map((run) => (
                <Table.Tr key={run.id} bg={run.id === selected ? "var(--accent-soft)" : undefined}>
                  <Table.Td>
                    <Link href={`/experiments/${run.id}`}>Run {run.id}</Link>
                  </Table.Td>
                  <Table.Td>{run.title}</Table.Td>
                  <Table.Td>{dateTime(run.started)}</Table.Td>
                  <Table.Td className={pageStyles.number}>{duration(run.duration_s)}</Table.Td>
                  <Table.Td>{run.who}</Table.Td>
                  <Table.Td>
                    <RunState state={run.end_state} reason={run.end_reason} unevaluated={unevaluated(run)} />
                  </Table.Td>
                </Table.Tr>
              ))}
            </Table.Tbody>
          </Table>
        </div>
      )}
    </Card>
  );
}

/** Criteria with pass or fail, and metrics, as tables. */

interface FiguresProps {
  readonly criteria: readonly Criterion[];
  readonly metrics: readonly Metric[];
  /** LocalizedText in the names of the tables where it is not the experiment itself. */
  readonly of?: string;
}

export function Figures({ criteria, metrics, of }: FiguresProps) {
  const angles = useAngleUnit();
  const named = (name: string) => (of === undefined ? name : `${name} of the ${of}`);
  return (
    <div className={pageStyles.halves}>
      {criteria.length > 0 && (
        <Table aria-label={named("Criteria")} verticalSpacing={4}>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>Criterion</Table.Th>
              <Table.Th className={pageStyles.number}>Value</Table.Th>
              <Table.Th>Bound</Table.Th>
              <Table.Th>Result</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {criteria.map((criterion) => (
              <Table.Tr key={criterion.name}>
                <Table.Td>
                  <Explained of={`figure:${criterion.name}`}>{criterion.label}</Explained>
                </Table.Td>
                <Table.Td className={pageStyles.number}>{figure(criterion, 3, angles)}</Table.Td>
                <Table.Td style={{ whiteSpace: "nowrap" }}>
                  {criterion.relation} {formatWithUnit(criterion.bound, criterion.unit, angles)}
                </Table.Td>
                <Table.Td>
                  <CriterionOutcome passed={criterion.passed} />
                  <Reason
                    text={criterion.reason}
                    seen={criterion.passed === false ? SEEN[criterion.relation] : undefined}
                  />
                </Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      )}
      {metrics.length > 0 && (
        <Table aria-label={named("Metrics")} verticalSpacing={4}>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>Metric</Table.Th>
              <Table.Th className={pageStyles.number}>Value</Table.Th>
              <Table.Th>Unit</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {metrics.map((metric) => (
              <Table.Tr key={metric.name}>
                <Table.Td>
                  <Explained of={figureEntry(metric)}>{metric.label}</Explained>
                  <Reason text={metric.reason} seen={metric.value === null ? undefined : SEEN["<"]} />
                </Table.Td>
                <Table.Td className={pageStyles.number}>
                  {measured(
                    metric.value === null
                      ? null
                      : metric.value * readingNear(metric.value, metric.unit, angles).factor,
                    4,
                  )}
                </Table.Td>
                <Table.Td>
                  <Unit unit={metric.unit} near={metric.value ?? undefined} />
                </Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      )}
    </div>
  );
}

/** A figure in SI as the person reads its unit. */
function figure(
  { value, unit }: { value: number | null; unit: string },
  digits: number,
  angles: AngleUnit,
): string {
  return measured(value === null ? null : value * readingOf(unit, angles).factor, digits);
}

function CriterionOutcome({ passed }: { passed: boolean | null }) {
  if (passed === null) {
    return (
      <Explained of="criterion:not_measured" quiet>
        {NOT_MEASURED}
      </Explained>
    );
  }
  const word = passed ? "pass" : "fail";
  return (
    <Verdict good={passed} of={`criterion:${word}`}>
      {word}
    </Verdict>
  );
}

/** What a figure that was not seen whole is, by the relation to its bound. */
export const SEEN: Record<string, string> = { "<": "at least this", ">": "at most this" };

/** Why there is no figure, or why it is that of a part only; `seen` says what it is then. */
export function Reason({ text, seen }: { text: string; seen?: string | undefined }) {
  const angles = useAngleUnit();
  if (text === "") return null;
  return (
    <div className={pageStyles.dim}>
      {seen === undefined ? "" : `${seen}: `}
      {localizeText(text, angles)}
    </div>
  );
}

/** One experiment: progress while it runs, then pass or fail per criterion, metrics, curves and downloads. */

export function ExperimentResult({ id }: { id: number }) {
  const { data, error } = useQuery(experimentQuery(id));
  if (data === undefined) {
    return (
      <Card title="Result">
        <p className={pageStyles.empty}>{error?.message ?? "Loading …"}</p>
      </Card>
    );
  }
  const running = isRunning(data.status);
  return (
    <>
      <Card title="Result" aside={<RunState state={data.status} reason={data.message} />}>
        <div className={pageStyles.fields}>
          <span>
            {data.title}, run {data.id}, {dateTime(data.created)}. <LocalizedText text={data.message} />
          </span>
          <RunSummary name={data.name} settings={data.settings} />
          {running ? <ExperimentProgress experiment={data} /> : <Findings experiment={data} />}
        </div>
      </Card>
      {!running && (
        <Card title="Curves">
          <div className={pageStyles.charts}>
            <RunCharts run={data.id} />
          </div>
        </Card>
      )}
    </>
  );
}

function ExperimentProgress({ experiment }: { experiment: Experiment }) {
  const task = useLive((live) => live.state?.task ?? null);
  const mine = task !== null && task.run === experiment.id && task.phase !== "evaluation";
  return <span>{mine ? "It runs; what it comes to stands here afterwards." : "computing the result …"}</span>;
}

function Findings({ experiment }: { experiment: Experiment }) {
  const { criteria, metrics, id } = experiment;
  return (
    <>
      <Outcome of={experiment} />
      <div className={pageStyles.actions}>
        <Downloads run={id} report />
      </div>
      <Figures criteria={criteria} metrics={metrics} />
    </>
  );
}
