/** Peaks with their times, mean and deviation of every signal in sight, renewed twice a second. */

import { useEffect, useState } from "react";
import { Shown } from "../components/Absent";
import { SignalName } from "../components/SignalName";
import { fixed } from "../samples/format";
import { type Statistics, statistics } from "../samples/statistics";
import type { SampleTable } from "../samples/table";
import type { Panel } from "../theme/signals";
import styles from "./Statistics.module.css";

const EVERY_MS = 500;

interface StatisticsTableProps {
  readonly panels: readonly Panel[];
  readonly hidden: ReadonlySet<string>;
  /** The samples in sight, or between the cursors. */
  table(): SampleTable;
  /** A moment as the time axis tells it. */
  timeText(time_s: number): string;
}

export function StatisticsTable({ panels, hidden, table, timeText }: StatisticsTableProps) {
  const [figures, setFigures] = useState<ReadonlyMap<string, Statistics>>(new Map());
  useEffect(() => {
    const renew = () => {
      const { t, columns } = table();
      setFigures(new Map(columns.map((column) => [column.name, statistics(column, t)])));
    };
    renew();
    const timer = window.setInterval(renew, EVERY_MS);
    return () => window.clearInterval(timer);
  }, [table]);
  const rows = panels.flatMap((panel) =>
    panel.traces
      .filter((trace) => !hidden.has(trace.name))
      .map((trace) => ({ panel, name: trace.name, key: `${panel.title} ${trace.name}` })),
  );
  return (
    <div className={styles.frame}>
      <table className={styles.table} aria-label="Statistics">
        <thead>
          <tr>
            {["Signal", "Min, at", "Max, at", "Mean", "Std dev", "Unit"].map((heading) => (
              <th key={heading} scope="col">
                {heading}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {rows.map(({ panel, name, key }) => {
            const figure = figures.get(name);
            const shown = (value: number | undefined, decimals: number) => (
              <Shown value={value} why="no value of it in sight">
                {(some) => fixed(some * panel.factor, decimals)}
              </Shown>
            );
            const at = (time_s: number | undefined) => (
              <div className={styles.when}>
                <Shown value={time_s} why="no value of it in sight">
                  {timeText}
                </Shown>
              </div>
            );
            return (
              <tr key={key}>
                <th scope="row">
                  <SignalName name={name} />
                </th>
                <td>
                  {shown(figure?.minimum, panel.decimals)}
                  {at(figure?.minimum_s)}
                </td>
                <td>
                  {shown(figure?.maximum, panel.decimals)}
                  {at(figure?.maximum_s)}
                </td>
                <td>{shown(figure?.mean, panel.decimals)}</td>
                <td>{shown(figure?.deviation, panel.decimals + 1)}</td>
                <td>{panel.unit}</td>
              </tr>
            );
          })}
        </tbody>
      </table>
    </div>
  );
}
