import { Progress } from "@mantine/core";
import { useEffect, useRef, useState } from "react";
import { SignalName, ValueOrReason } from "../components/values";
import { type Basis, type Figures, figuresOf } from "../samples/analysis";
import { fixed, significant } from "../samples/format";
import { fillText } from "../samples/texts";
import type { SampleTable, TimeRange } from "../samples/timeSeries";
import type { Panel } from "../theme/signals";
import styles from "./Statistics.module.css";
import type { StoredData } from "./storedRuns";
import { TEXTS } from "./texts";

/** Statistics of the visible range, or between the cursors: from the page's samples, or from the service. */

const EVERY_MS = 500;
/** Interval of the checks whether the range has changed and is stable. */
const CHECK_MS = 200;

interface ShownStatistics {
  /** Null before the first result. */
  readonly figures: Figures | null;
  /** Progress of the current request, 0 to 1; null when it is complete. */
  readonly share: number | null;
  /** Reason for missing statistics; empty if there are any. */
  readonly problem: string;
}

interface StatisticsRequest {
  readonly names: readonly string[];
  /** Visible range, or the range between the cursors. */
  range(): TimeRange;
  table(): SampleTable;
}

/** Statistics of a range. `names` and `stored` must keep their identity while their content is the same. */
export function useStatistics(
  { names, range, table }: StatisticsRequest,
  stored: StoredData | null,
): ShownStatistics {
  const [shown, setShown] = useState<ShownStatistics>({ figures: null, share: null, problem: "" });
  const latest = useRef({ range, table });
  latest.current = { range, table };
  useEffect(() => {
    if (stored === null) {
      const refresh = () =>
        setShown({ figures: figuresOf(latest.current.table()), share: null, problem: "" });
      refresh();
      const timer = window.setInterval(refresh, EVERY_MS);
      return () => window.clearInterval(timer);
    }
    let [seen, requested] = ["", ""];
    let request = new AbortController();
    const check = () => {
      const now = latest.current.range();
      const key = `${now.from_s} ${now.to_s}`;
      const isStable = key === seen || requested === "";
      seen = key;
      if (key === requested || !isStable) return;
      requested = key;
      request.abort();
      request = new AbortController();
      const { signal } = request;
      const update = (part: Partial<ShownStatistics>) => {
        if (!signal.aborted) setShown((before) => ({ ...before, problem: "", ...part }));
      };
      update({ share: 0 });
      stored
        .statistics(names, now, { signal, onShare: (share) => update({ share }) })
        .then((figures) => update({ figures, share: null }))
        .catch((error: Error) => update({ figures: null, share: null, problem: error.message }));
    };
    check();
    const timer = window.setInterval(check, CHECK_MS);
    return () => {
      window.clearInterval(timer);
      request.abort();
    };
  }, [names, stored]);
  return shown;
}

/** Text of the data basis of statistics. Pure. */

/** "every sample between 0:00.000 and 9:59.999: 599 988 samples, 12 missing"; one text per recording. */
export function describeBasis(basis: readonly Basis[], timeText: (time_s: number) => string): string {
  if (basis.length === 0) return TEXTS.noSampleInRange;
  return basis.map((one) => wordsOf(one, timeText)).join("; ");
}

function wordsOf(basis: Basis, timeText: (time_s: number) => string): string {
  const words = wordsOfOne(basis, timeText);
  return basis.of === "" ? words : fillText(TEXTS.ofRecording, { recording: basis.of, words });
}
function wordsOfOne(
  { range, samples, missing, bucket_s }: Basis,
  timeText: (time_s: number) => string,
): string {
  if (range === null) return TEXTS.noSampleInRange;
  const fields = { from: timeText(range.from_s), to: timeText(range.to_s), count: grouped(samples) };
  if (bucket_s !== null) return fillText(TEXTS.extremes, { ...fields, bucket: significant(bucket_s, 3) });
  return missing === 0
    ? fillText(TEXTS.everySample, fields)
    : fillText(TEXTS.everySampleBut, { ...fields, missing: grouped(missing) });
}

/** An integer with its digits in groups of three. */
export function grouped(count: number): string {
  return fixed(count, 0).replaceAll(/\B(?=(\d{3})+$)/g, "\u202f");
}

/** Extremes with their times, mean and deviation of every visible signal, with their data basis. */

interface StatisticsTableProps {
  readonly panels: readonly Panel[];
  readonly hidden: ReadonlySet<string>;
  readonly shown: ShownStatistics;
  /** Formats a time like the time axis. */
  timeText(time_s: number): string;
}

const HEADINGS = [
  [TEXTS.signal, undefined],
  [TEXTS.values, TEXTS.valuesHint],
  [TEXTS.min, undefined],
  [TEXTS.max, undefined],
  [TEXTS.mean, undefined],
  [TEXTS.deviation, TEXTS.deviationHint],
  [TEXTS.columnUnit, undefined],
] as const;

function StatisticsTable({ panels, hidden, shown, timeText }: StatisticsTableProps) {
  const { figures, share, problem } = shown;
  const rows = panels.flatMap((panel) =>
    panel.traces
      .filter((trace) => !hidden.has(trace.name))
      .map((trace) => ({ panel, name: trace.name, key: `${panel.title} ${trace.name}` })),
  );
  const ofBuckets = figures?.basis.some(({ bucket_s }) => bucket_s !== null) === true;
  const none = figures === null ? TEXTS.notComputedYet : TEXTS.noValueInRange;
  return (
    <div className={styles.frame} aria-busy={share !== null}>
      <table className={styles.table} aria-label={TEXTS.statistics} data-old={share !== null}>
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
            const number = (value: number | undefined, decimals: number, why: string = none) => (
              <ValueOrReason value={value} why={why}>
                {(some) => fixed(some * panel.factor, decimals)}
              </ValueOrReason>
            );
            const at = (time_s: number | undefined) => (
              <div className={styles.when}>
                <ValueOrReason value={time_s} why={none}>
                  {timeText}
                </ValueOrReason>
              </div>
            );
            const needsAll = ofBuckets ? TEXTS.needsEverySample : none;
            return (
              <tr key={key}>
                <th scope="row">
                  <SignalName name={name} />
                </th>
                <td>
                  <ValueOrReason value={ofBuckets ? undefined : figure?.values} why={needsAll}>
                    {grouped}
                  </ValueOrReason>
                  {figure !== undefined && !ofBuckets && figure.withoutValue > 0 && (
                    <div className={styles.when}>
                      {fillText(TEXTS.withoutValue, { count: grouped(figure.withoutValue) })}
                    </div>
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
      <output className={styles.foot} aria-label={TEXTS.statisticsFacts}>
        {problem !== "" && fillText(TEXTS.notComputed, { reason: problem })}
        {problem === "" &&
          figures !== null &&
          fillText(TEXTS.from, { basis: describeBasis(figures.basis, timeText) })}
        {share !== null && ` ${fillText(TEXTS.statisticsReading, { percent: fixed(100 * share, 0) })}`}
      </output>
      {share !== null && <Progress value={100 * share} size={3} aria-label={TEXTS.statisticsProgress} />}
    </div>
  );
}

/** Statistics of the visible range, or between the cursors, while they are shown. */

interface RangeStatisticsProps {
  readonly panels: readonly Panel[];
  readonly hidden: ReadonlySet<string>;
  readonly names: readonly string[];
  readonly stored: StoredData | null;
  range(): TimeRange;
  table(): SampleTable;
  timeText(time_s: number): string;
}

export function RangeStatistics(props: RangeStatisticsProps) {
  const { panels, hidden, names, stored, range, table, timeText } = props;
  const shown = useStatistics({ names, range, table }, stored);
  return <StatisticsTable panels={panels} hidden={hidden} shown={shown} timeText={timeText} />;
}
