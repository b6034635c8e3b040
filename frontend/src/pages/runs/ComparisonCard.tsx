/** The metrics of several runs beside each other, with the differences to one of them. */

import { Group, NativeSelect, Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { Explained } from "../../components/Explained";
import { SeriesReports } from "../../components/SeriesReports";
import { Unit } from "../../components/Unit";
import { dateTime, measured, significant } from "../../samples/format";
import { type Angles, inWords, readingOf } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { figureEntry } from "../../service/glossary";
import { comparisonQuery } from "../../service/queries";
import type { ComparedMetric } from "../../wire/types";
import { Reason, SEEN } from "../experiments/Figures";
import page from "../Page.module.css";
import styles from "./Runs.module.css";

export function ComparisonCard({ runs }: { runs: readonly number[] }) {
  const [chosen, setChosen] = useState<number | null>(null);
  const reference = chosen !== null && runs.includes(chosen) ? chosen : (runs[0] as number);
  const { data, error, isPlaceholderData } = useQuery(comparisonQuery(runs, reference));
  const angles = useAngles();
  return (
    <Card
      title="Comparison"
      aside={
        <Group gap="xs">
          <SeriesReports runs={runs} />
          <NativeSelect
            aria-label="Differences to"
            value={String(reference)}
            onChange={(event) => setChosen(Number(event.currentTarget.value))}
            data={runs.map((id) => ({ value: String(id), label: `differences to run ${id}` }))}
          />
        </Group>
      }
    >
      {data === undefined ? (
        <p className={page.empty}>{error?.message ?? "Loading …"}</p>
      ) : (
        <div className={`${page.tableScroll} ${styles.answer}`} aria-busy={isPlaceholderData}>
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
          {data.metrics.length === 0 && <p className={page.empty}>None of these runs has a result.</p>}
        </div>
      )}
    </Card>
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

/** "+0.5 (+12 %)"; nothing where both are the same, or one is not there. */
function difference(value: number | null, percent: number | null, factor: number): string {
  if (value === null || value === 0) return "";
  const sign = value > 0 ? "+" : "";
  const relative = percent === null ? "" : ` (${sign}${significant(percent, 3)} %)`;
  return `${sign}${significant(value * factor, 4)}${relative}`;
}
