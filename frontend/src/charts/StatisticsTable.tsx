/** Peaks with their times, mean and deviation of every signal in sight, with what they were computed from. */

import { Progress } from "@mantine/core";
import { Shown } from "../components/Absent";
import { SignalName } from "../components/SignalName";
import { fixed } from "../samples/format";
import type { Panel } from "../theme/signals";
import { basisWords, grouped } from "./basisWords";
import styles from "./Statistics.module.css";
import type { ShownStatistics } from "./useStatistics";

interface StatisticsTableProps {
  readonly panels: readonly Panel[];
  readonly hidden: ReadonlySet<string>;
  readonly shown: ShownStatistics;
  /** A moment as the time axis tells it. */
  timeText(time_s: number): string;
}

const HEADINGS = [
  ["Signal", undefined],
  ["Values", "Samples that have a value. Those without one were not measured, or not in force."],
  ["Min, at", undefined],
  ["Max, at", undefined],
  ["Mean", undefined],
  ["Std dev", "Standard deviation about the mean, divided by the number of values."],
  ["Unit", undefined],
] as const;

export function StatisticsTable({ panels, hidden, shown, timeText }: StatisticsTableProps) {
  const { figures, share, problem } = shown;
  const rows = panels.flatMap((panel) =>
    panel.traces
      .filter((trace) => !hidden.has(trace.name))
      .map((trace) => ({ panel, name: trace.name, key: `${panel.title} ${trace.name}` })),
  );
  const ofBuckets = figures?.basis.some(({ bucket_s }) => bucket_s !== null) === true;
  const none = figures === null ? "not computed yet" : "no sample of this range has a value";
  return (
    <div className={styles.frame} aria-busy={share !== null}>
      <table className={styles.table} aria-label="Statistics" data-old={share !== null}>
        <thead>
          <tr>
            {HEADINGS.map(([heading, hint]) => (
              <th key={heading} scope="col" title={hint}>
                {heading}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {rows.map(({ panel, name, key }) => {
            const figure = figures?.signals.get(name);
            const number = (value: number | undefined, decimals: number, why = none) => (
              <Shown value={value} why={why}>
                {(some) => fixed(some * panel.factor, decimals)}
              </Shown>
            );
            const at = (time_s: number | undefined) => (
              <div className={styles.when}>
                <Shown value={time_s} why={none}>
                  {timeText}
                </Shown>
              </div>
            );
            const needsAll = ofBuckets ? "it needs every sample: only min and max are here" : none;
            return (
              <tr key={key}>
                <th scope="row">
                  <SignalName name={name} />
                </th>
                <td>
                  <Shown value={ofBuckets ? undefined : figure?.values} why={needsAll}>
                    {grouped}
                  </Shown>
                  {figure !== undefined && !ofBuckets && figure.withoutValue > 0 && (
                    <div className={styles.when}>{grouped(figure.withoutValue)} without value</div>
                  )}
                </td>
                <td>
                  {number(figure?.minimum, panel.decimals)}
                  {at(figure?.minimum_s)}
                </td>
                <td>
                  {number(figure?.maximum, panel.decimals)}
                  {at(figure?.maximum_s)}
                </td>
                <td>{number(figure?.mean, panel.decimals, needsAll)}</td>
                <td>{number(figure?.deviation, panel.decimals + 1, needsAll)}</td>
                <td>{panel.unit}</td>
              </tr>
            );
          })}
        </tbody>
      </table>
      <output className={styles.foot} aria-label="Statistics facts">
        {problem !== "" && `Not computed: ${problem}`}
        {problem === "" && figures !== null && `From ${basisWords(figures.basis, timeText)}.`}
        {share !== null && ` Reading every sample of the new range: ${fixed(100 * share, 0)} %`}
      </output>
      {share !== null && <Progress value={100 * share} size={3} aria-label="Statistics progress" />}
    </div>
  );
}
