/** The metrics of several runs beside each other, with the differences to one of them. */

import { Button, Group, Table } from "@mantine/core";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { Explained } from "../../components/Explained";
import { SeriesReports } from "../../components/SeriesReports";
import { Unit } from "../../components/Unit";
import { dateTime, measured, significant } from "../../samples/format";
import { type Angles, inWords, readingOf } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { type ComparisonAsked, comparisonFile } from "../../service/comparison";
import { figureEntry } from "../../service/glossary";
import type { ComparedMetric, RunComparison } from "../../wire/types";
import { Reason, SEEN } from "../experiments/Figures";
import page from "../Page.module.css";
import { DifferingSettings } from "./DifferingSettings";
import styles from "./Runs.module.css";

interface ComparisonCardProps {
  readonly asked: ComparisonAsked;
  /** Of which the file of curves is. */
  readonly signal: string;
  /** What the service said last, maybe of another reference. */
  readonly told: RunComparison | undefined;
  readonly error: Error | null;
}

export function ComparisonCard({ asked, signal, told: data, error }: ComparisonCardProps) {
  const { reference } = asked;
  const angles = useAngles();
  return (
    <Card title="Comparison" aside={<Files asked={asked} signal={signal} />}>
      {data === undefined ? (
        <p className={page.empty}>{error?.message ?? "Loading …"}</p>
      ) : (
        <div className={styles.answer} aria-busy={data.reference !== reference}>
          <p className={page.dim}>Below each metric: the difference to run {reference}.</p>
          <div className={page.tableScroll}>
            <Table aria-label="Comparison" verticalSpacing={4}>
              <Table.Thead>
                <Table.Tr>
                  <Table.Th>Metric</Table.Th>
                  {data.runs.map((run) => (
                    <Table.Th key={run.id} className={page.number} title={inWords(run.verdict, angles)}>
                      <Link href={`/runs/${run.id}`}>Run {run.id}</Link>
                      <div className={page.dim}>{run.title}</div>
                      <div className={page.dim}>{dateTime(run.started)}</div>
                    </Table.Th>
                  ))}
                  <Table.Th>Unit</Table.Th>
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
          {data.metrics.length === 0 && <p className={page.empty}>None of these runs has a result.</p>}
          <DifferingSettings told={data} />
        </div>
      )}
    </Card>
  );
}

/** One report of all these runs, in their order, and the comparison as text. */
function Files({ asked, signal }: { asked: ComparisonAsked; signal: string }) {
  const files = [
    { label: "Table (CSV)", href: comparisonFile("table", asked, signal) },
    { label: `Curves of ${signal} (CSV)`, href: comparisonFile("curves", asked, signal) },
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
  readonly angles: Angles;
  /** Whether the differences are to the run that is named. */
  readonly compared: boolean;
}

function Value({ metric, index, angles, compared }: ValueProps) {
  const found = metric.values[index];
  if (found === undefined) return <Table.Td />;
  const { factor } = readingOf(metric.unit, angles);
  const value = found.value === null ? null : found.value * factor;
  return (
    <Table.Td className={page.number}>
      {measured(value, 4)}
      {compared && <div className={page.dim}>{difference(found.difference, found.percent, factor)}</div>}
      <Reason text={found.reason} seen={value === null ? undefined : SEEN["<"]} />
    </Table.Td>
  );
}

/** Two that differ by less are the same but for the last digits of their computation [%]. */
const SAME_PERCENT = 1e-9;

/** "+0.5 (+12 %)"; nothing where both are the same, or one is not there. */
function difference(value: number | null, percent: number | null, factor: number): string {
  if (value === null || value === 0 || Math.abs(percent ?? 100) < SAME_PERCENT) return "";
  const sign = value > 0 ? "+" : "";
  const relative = percent === null ? "" : ` (${sign}${significant(percent, 3)} %)`;
  return `${sign}${significant(value * factor, 4)}${relative}`;
}
