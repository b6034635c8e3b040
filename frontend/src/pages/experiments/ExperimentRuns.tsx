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
import { fillText } from "../../samples/texts";
import { experimentQuery } from "../../service/api/experiments";
import { isRunning } from "../../service/api/polling";
import { useAngleUnit } from "../../service/api/preferences";
import { figureEntry } from "../../service/glossary";
import type { Criterion, Experiment, Metric, Run } from "../../wire/types";
import pageStyles from "../Page.module.css";
import { RunCharts } from "../runs/RunCharts";
import { RunSummary } from "./ExperimentForm";
import { TEXTS } from "./texts";

/** Lists earlier experiments. */
export function ExperimentRuns({
  runs,
  selected,
}: {
  runs: readonly Run[] | undefined;
  selected: number | undefined;
}) {
  return (
    <Card title={TEXTS.earlierExperiments}>
      {(runs === undefined || runs.length === 0) && (
        <p className={pageStyles.empty}>{runs === undefined ? TEXTS.loading : TEXTS.noExperiments}</p>
      )}
      {runs !== undefined && runs.length > 0 && (
        <div className={pageStyles.tableScroll}>
          <Table aria-label={TEXTS.earlierExperiments} highlightOnHover>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>{TEXTS.run}</Table.Th>
                <Table.Th>{TEXTS.kind}</Table.Th>
                <Table.Th>{TEXTS.started}</Table.Th>
                <Table.Th className={pageStyles.number}>{TEXTS.duration}</Table.Th>
                <Table.Th>{TEXTS.person}</Table.Th>
                <Table.Th>{TEXTS.status}</Table.Th>
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {runs.map((run) => (
                <Table.Tr key={run.id} bg={run.id === selected ? "var(--accent-soft)" : undefined}>
                  <Table.Td>
                    <Link href={`/experiments/${run.id}`}>{fillText(TEXTS.runLink, { run: run.id })}</Link>
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

interface FiguresProps {
  readonly criteria: readonly Criterion[];
  readonly metrics: readonly Metric[];
  /** Source of the values in the names of the tables, if it is not the experiment itself. */
  readonly of?: string;
}

/** Shows criteria with pass or fail, and metrics, as tables. */
export function Figures({ criteria, metrics, of }: FiguresProps) {
  const angles = useAngleUnit();
  return (
    <div className={pageStyles.halves}>
      {criteria.length > 0 && (
        <Table
          aria-label={of === undefined ? TEXTS.criteria : fillText(TEXTS.criteriaOf, { source: of })}
          verticalSpacing={4}
        >
          <Table.Thead>
            <Table.Tr>
              <Table.Th>{TEXTS.criterion}</Table.Th>
              <Table.Th className={pageStyles.number}>{TEXTS.value}</Table.Th>
              <Table.Th>{TEXTS.bound}</Table.Th>
              <Table.Th>{TEXTS.outcome}</Table.Th>
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
        <Table
          aria-label={of === undefined ? TEXTS.metrics : fillText(TEXTS.metricsOf, { source: of })}
          verticalSpacing={4}
        >
          <Table.Thead>
            <Table.Tr>
              <Table.Th>{TEXTS.metric}</Table.Th>
              <Table.Th className={pageStyles.number}>{TEXTS.value}</Table.Th>
              <Table.Th>{TEXTS.unit}</Table.Th>
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

/** Formats a value in SI in the person's unit. */
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
      {TEXTS[word]}
    </Verdict>
  );
}

/** Description of a bounded value, by its relation to the bound. */
export const SEEN: Record<string, string> = { "<": TEXTS.atLeast, ">": TEXTS.atMost };

/** Shows why a value is missing or incomplete; `seen` describes an incomplete value. */
export function Reason({ text, seen }: { text: string; seen?: string | undefined }) {
  const angles = useAngleUnit();
  if (text === "") return null;
  const reason = localizeText(text, angles);
  return (
    <div className={pageStyles.dim}>
      {seen === undefined ? reason : fillText(TEXTS.boundedReason, { bound: seen, reason })}
    </div>
  );
}

/** Shows one experiment: its progress, then its criteria, metrics, curves and downloads. */
export function ExperimentResult({ id }: { id: number }) {
  const { data, error } = useQuery(experimentQuery(id));
  if (data === undefined) {
    return (
      <Card title={TEXTS.result}>
        <p className={pageStyles.empty}>{error?.message ?? TEXTS.loading}</p>
      </Card>
    );
  }
  const running = isRunning(data.status);
  return (
    <>
      <Card title={TEXTS.result} aside={<RunState state={data.status} reason={data.message} />}>
        <div className={pageStyles.fields}>
          <span>
            {fillText(TEXTS.resultOf, {
              experiment: data.title,
              run: data.id,
              time: dateTime(data.created),
            })}{" "}
            <LocalizedText text={data.message} />
          </span>
          <RunSummary name={data.name} settings={data.settings} />
          {running ? <ExperimentProgress experiment={data} /> : <Findings experiment={data} />}
        </div>
      </Card>
      {!running && (
        <Card title={TEXTS.curves}>
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
  return <span>{mine ? TEXTS.running : TEXTS.computingResult}</span>;
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
