import { useDebouncedValue } from "@mantine/hooks";
import { useQueries, useQuery } from "@tanstack/react-query";
import { useEffect, useMemo, useRef, useState } from "react";
import { Charts } from "../../charts/Charts";
import type { PlacedMark } from "../../charts/decorations";
import { TraceLine } from "../../charts/PanelRow";
import {
  ComparedSource,
  comparedPanels,
  markOf,
  type PlotSource,
  RecordedSource,
  ShiftedSource,
  traceOf,
} from "../../charts/sources";
import { StoredRuns } from "../../charts/storedRuns";
import { Playhead, useViewport, type ViewControl, type Viewport, visibleRange } from "../../charts/viewport";
import { plantWord } from "../../components/Header";
import { useLive } from "../../live/react";
import { significant } from "../../samples/format";
import { type AngleUnit, localizeText } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import type { TimeRange } from "../../samples/timeSeries";
import { banksQuery } from "../../service/api/banks";
import { useAngleUnit } from "../../service/api/preferences";
import { recordingQuery } from "../../service/api/recordings";
import { runMarksQuery, runQuery } from "../../service/api/runs";
import { describeBank } from "../../service/api/tuning";
import { HUES, isSum, type Trace } from "../../theme/signals";
import { usePanels } from "../../theme/useLayouts";
import type { Excerpt } from "../../wire/curves";
import { AT_HAND_SAMPLES, PERIOD_S } from "../../wire/sample.gen";
import type { Bank, RunMark } from "../../wire/types";
import { limitLines } from "../operate/LiveCharts";
import page from "../Page.module.css";
import { Replay } from "./Replay";
import replay from "./Replay.module.css";
import { TEXTS } from "./texts";

/** Loads ranges of recordings. Of a long range, stored summaries load first, computed signals later. */

/** Above this length [s], the service computes sums and differences from all samples in a worker process. */
export const LONG_S = AT_HAND_SAMPLES * PERIOD_S;

interface Asked {
  readonly id: number;
  readonly stretch: TimeRange;
  readonly wanted: boolean;
}

interface Excerpts {
  /** In the order of `asked`; the same array until new data arrive. */
  readonly excerpts: readonly (Excerpt | undefined)[];
  /** Text on signals that are pending or failed; "" if none. */
  readonly pending: string;
}

/** Loads an excerpt for each element of `asked`, whose length must not change. */
export function useExcerpts(asked: readonly Asked[], points: number, signals: readonly string[]): Excerpts {
  const sums = signals.filter(isSum);
  const stored = signals.filter((name) => !isSum(name));
  const apart = asked.map(({ stretch }) => sums.length > 0 && stretch.to_s - stretch.from_s > LONG_S);
  const first = useQueries({
    queries: asked.map(({ id, stretch, wanted }, index) => ({
      ...recordingQuery(id, stretch, points, apart[index] ? stored : signals),
      enabled: wanted,
    })),
  });
  const second = useQueries({
    queries: asked.map(({ id, stretch, wanted }, index) => ({
      ...recordingQuery(id, stretch, points, sums),
      enabled: wanted && apart[index] === true,
    })),
  });
  const joined = asked.map((_, index) => [
    first[index]?.data,
    apart[index] ? second[index]?.data : undefined,
  ]);
  const excerpts = useSame(joined.flat());
  const missing = second.filter((one, index) => apart[index] && asked[index]?.wanted && !one.data);
  return {
    // biome-ignore lint/correctness/useExhaustiveDependencies: the elements decide, not the arrays around them
    excerpts: useMemo(() => joined.map(([a, b]) => together(a, b)), [excerpts]),
    pending: describePending(sums, missing.find((one) => one.error)?.error ?? null, missing.length),
  };
}

/** Merges both parts of an excerpt; omits part b if its buckets differ because the recording grew. */
export function together(a: Excerpt | undefined, b: Excerpt | undefined): Excerpt | undefined {
  if (a === undefined || b === undefined || a.t.length !== b.t.length || a.t[0] !== b.t[0]) return a;
  return { ...a, signals: { ...a.signals, ...b.signals } };
}

function describePending(sums: readonly string[], error: Error | null, missing: number): string {
  const names = sums.map((name) => name.replace(" - ", " − ")).join(", ");
  if (error !== null) return fillText(TEXTS.notComputed, { signals: names, reason: error.message });
  return missing > 0 ? fillText(TEXTS.computing, { signals: names }) : "";
}

/** Returns the same array while its elements are the same. */
function useSame<Element>(elements: readonly Element[]): readonly Element[] {
  const stable = useRef(elements);
  const same =
    stable.current.length === elements.length &&
    stable.current.every((one, index) => one === elements[index]);
  if (!same) stable.current = elements;
  return stable.current;
}

/** Sources of curves of recorded runs, with more detail in the view once it is at rest. */

/** Signals of the actuator drawing and of the footer of pictures, loaded whatever the charts show. */
const ALWAYS = ["q", "q_ref", "S", "theta_A", "theta_B", "F_A", "F_B", "lam_q", "lam_S", "bank_entry"];
const POINTS = 2000;
const RESTED_MS = 80;

export interface Recorded {
  readonly id: number;
  readonly duration_s: number;
  /** Shift of its times onto the axis of the charts [s]. */
  readonly offset_s?: number;
}

/** Returns the time range that the runs cover. */
export function covered(runs: readonly Recorded[]): TimeRange {
  return {
    from_s: Math.min(...runs.map(({ offset_s = 0 }) => offset_s)),
    to_s: Math.max(...runs.map(({ offset_s = 0, duration_s }) => offset_s + duration_s)),
  };
}

export interface Recordings {
  readonly sources: readonly RecordedSource[];
  /** Text on the resolution of the first run's curves and on pending signals. */
  readonly resolution: string;
}

/** Loads the runs for the view. `runs` must be the same array while its elements are equal. */
export function useRecordings(runs: readonly Recorded[], view: Viewport): Recordings {
  const panels = usePanels();
  const signals = useMemo(() => {
    const drawn = panels.flatMap(({ traces, over }) => [...traces, ...(over === undefined ? [] : [over])]);
    return [...new Set([...drawn.map(({ name }) => name), ...ALWAYS])];
  }, [panels]);
  const sources = useMemo(() => runs.map(({ duration_s }) => new RecordedSource(duration_s)), [runs]);
  const overviews = useExcerpts(
    runs.map(({ id, duration_s }) => ({ id, stretch: { from_s: 0, to_s: duration_s }, wanted: true })),
    POINTS,
    signals,
  );
  const whole = covered(runs);
  const seen = visibleRange(view, whole.to_s);
  // the first change of the view loads data at once, further changes once the view is at rest
  const wanted = useSteady(widened(seen, whole));
  const [rested] = useDebouncedValue(wanted, RESTED_MS, { leading: true });
  const parts = runs.map(({ duration_s, offset_s = 0 }) => {
    const own = (time_s: number) => Math.min(Math.max(0, time_s - offset_s), duration_s);
    return { from_s: own(rested.from_s), to_s: own(rested.to_s) };
  });
  const zoomed = parts.map(
    ({ from_s, to_s }, index) => to_s - from_s < (runs[index] as Recorded).duration_s && to_s > from_s,
  );
  const details = useExcerpts(
    runs.map(({ id }, index) => ({
      id,
      stretch: parts[index] as TimeRange,
      wanted: zoomed[index] === true,
    })),
    2 * POINTS,
    signals,
  );

  useEffect(() => {
    overviews.excerpts.forEach((data, index) => {
      if (data) sources[index]?.setOverview(data);
    });
  }, [overviews.excerpts, sources]);
  // biome-ignore lint/correctness/useExhaustiveDependencies: the data belong to the range that was requested with them
  useEffect(() => {
    details.excerpts.forEach((data, index) => {
      if (data && zoomed[index]) sources[index]?.setDetail(parts[index] as TimeRange, data);
    });
  }, [details.excerpts, sources]);

  const first = parts[0] as TimeRange;
  const { duration_s, offset_s = 0 } = runs[0] as Recorded;
  const fits =
    zoomed[0] &&
    first.from_s <= Math.max(0, seen.from_s - offset_s) &&
    first.to_s >= Math.min(seen.to_s - offset_s, duration_s);
  const shown = fits ? details : overviews;
  return { sources, resolution: [resolution(shown.excerpts[0]), shown.pending].filter(Boolean).join("; ") };
}

/** Returns the same object while its values are equal; a new object would restart the debounce. */
function useSteady({ from_s, to_s }: TimeRange): TimeRange {
  return useMemo(() => ({ from_s, to_s }), [from_s, to_s]);
}

function resolution(shown: Excerpt | undefined): string {
  if (shown === undefined) return TEXTS.loading;
  return shown.raw ? TEXTS.allSamples : fillText(TEXTS.minMax, { width: significant(shown.width_s, 3) });
}

/** Returns a range with a third more on each side, so that a small pan needs no new data. */
function widened({ from_s, to_s }: TimeRange, whole: TimeRange): TimeRange {
  const margin = (to_s - from_s) / 3;
  return {
    from_s: Math.max(whole.from_s, from_s - margin),
    to_s: Math.max(from_s, Math.min(whole.to_s, to_s + margin)),
  };
}

/** Charts of one recorded run with its replay, or of several runs. */

const NO_MARKS: readonly RunMark[] = [];

const NO_BANKS: readonly Bank[] = [];
const NO_OTHERS: readonly number[] = [];

/** Trace whose line style the legend shows. */
const MEASURED: Trace = { name: "q", hue: HUES.q, dashed: false };

interface RunChartsProps {
  readonly run: number;
  /** First position of the playhead. */
  readonly at_s?: number | null;
  readonly others?: readonly number[];
  /** For compared runs: offsets to the time axis of the reference, whose marks are shown. */
  readonly placed?: Placed;
}

/** Reference and time offsets [s]; runs without an offset are not drawn. */
export interface Placed {
  readonly reference: number;
  readonly offsets: ReadonlyMap<number, number>;
}

/** Charts of a run and of `others`, which must be the same array while its elements are equal. */
export function RunCharts({ run, at_s = null, others = NO_OTHERS, placed }: RunChartsProps) {
  const asked = useQueries({ queries: [run, ...others].map((id) => runQuery(id)) });
  const error = asked.find((one) => one.error)?.error;
  if (error) return <p className={page.empty}>{error.message}</p>;
  const found = asked.map(({ data }) => data).filter((data) => data !== undefined);
  if (found.length < asked.length) return <p className={page.empty}>{TEXTS.loading}</p>;
  const silent = found.filter(({ samples }) => samples === 0).map(({ id }) => id);
  if (silent.includes(run) && placed === undefined) {
    return <p className={page.empty}>{TEXTS.noSamples}</p>;
  }
  const drawn = found
    .filter(({ id, samples }) => samples > 0 && (placed === undefined || placed.offsets.has(id)))
    .map(({ id, duration_s }) => ({ id, duration_s, offset_s: placed?.offsets.get(id) ?? 0 }));
  const key = drawn.map(({ id, duration_s, offset_s }) => `${id}:${duration_s}:${offset_s}`).join(" ");
  if (drawn.length === 0) return <p className={page.empty}>{TEXTS.noneDrawn}</p>;
  return placed === undefined && drawn.length === 1 ? (
    <OneRun
      key={`${key} ${at_s}`}
      run={run}
      at_s={at_s ?? 0}
      duration_s={(drawn[0] as Recorded).duration_s}
      silent={silent}
    />
  ) : (
    <SeveralRuns key={key} runs={drawn} silent={silent} reference={placed?.reference ?? run} />
  );
}

function OneRun({ run, at_s, duration_s, silent }: OneRunProps) {
  const home = useMemo(() => ({ span_s: duration_s, end_s: duration_s }), [duration_s]);
  const control = useViewport(around(home, at_s));
  const runs = useMemo(() => [{ id: run, duration_s }], [run, duration_s]);
  const { sources, resolution } = useRecordings(runs, control.view);
  const source = sources[0] as PlotSource;
  const [playhead] = useState(() => new Playhead(Math.min(at_s, duration_s)));
  return (
    <div className={replay.withReplay}>
      <RecordedCharts
        runs={runs}
        silent={silent}
        marksOf={run}
        source={source}
        control={control}
        home={home}
        playhead={playhead}
        resolution={resolution}
      />
      <Replay playhead={playhead} run={run} source={source} duration_s={duration_s} />
    </div>
  );
}

/** Length of the view on a long recording that is opened at a time [s]. */
const AROUND_S = 20;

function around(home: { span_s: number; end_s: number }, at_s: number): Viewport {
  if (at_s === 0 || home.span_s <= AROUND_S) return home;
  const end_s = Math.min(Math.max(at_s + AROUND_S / 2, AROUND_S), home.end_s);
  return { span_s: AROUND_S, end_s };
}

interface OneRunProps {
  readonly run: number;
  readonly at_s: number;
  readonly duration_s: number;
  readonly silent: readonly number[];
}

interface SeveralRunsProps {
  readonly runs: readonly Recorded[];
  readonly silent: readonly number[];
  readonly reference: number;
}

/** Charts of several runs. React remounts them for other runs, so the first `runs` remain valid. */
function SeveralRuns({ runs, silent, reference }: SeveralRunsProps) {
  const [fixedRuns] = useState(runs);
  const home = useMemo(() => {
    const { from_s, to_s } = covered(fixedRuns);
    return { span_s: to_s - from_s, end_s: to_s };
  }, [fixedRuns]);
  const control = useViewport(home);
  const { sources, resolution } = useRecordings(fixedRuns, control.view);
  const source = useMemo(
    () => new ComparedSource(...sources.map((own, n) => new ShiftedSource(own, fixedRuns[n]?.offset_s ?? 0))),
    [sources, fixedRuns],
  );
  return (
    <RecordedCharts
      runs={fixedRuns}
      silent={silent}
      marksOf={reference}
      source={source}
      control={control}
      home={home}
      resolution={resolution}
    />
  );
}

interface RecordedChartsProps {
  readonly runs: readonly Recorded[];
  /** Requested runs without samples. */
  readonly silent: readonly number[];
  /** The run whose time the axis shows. */
  readonly marksOf: number;
  readonly source: PlotSource;
  readonly control: ViewControl;
  readonly home: Viewport;
  readonly playhead?: Playhead;
  readonly resolution: string;
}

function RecordedCharts(props: RecordedChartsProps) {
  const { runs, silent, marksOf, source, control, home, playhead, resolution } = props;
  const run = (runs[0] as Recorded).id;
  const further = runs.length - 1;
  const panels = usePanels();
  const angles = useAngleUnit();
  const limits = useLive((live) => live.state?.limits);
  const { data: found } = useQuery(runQuery(run));
  const { data: banks = NO_BANKS } = useQuery(banksQuery);
  const started = found?.started;
  const began = useMemo(() => {
    const epoch_s = started === undefined ? Number.NaN : Date.parse(started) / 1000;
    return Number.isNaN(epoch_s) ? undefined : () => epoch_s;
  }, [started]);
  const { data: marks = NO_MARKS } = useQuery(runMarksQuery(marksOf));
  return (
    <Charts
      panels={useMemo(() => (further === 0 ? panels : comparedPanels(panels, further)), [panels, further])}
      source={source}
      stored={useMemo(() => new StoredRuns(runs), [runs])}
      control={control}
      home={home}
      longest_s={home.span_s}
      limits={useMemo(() => limitLines(limits, angles), [limits, angles])}
      marks={useMemo(() => marks.map((mark) => placed(mark, angles)), [marks, angles])}
      stale={false}
      {...(playhead === undefined ? {} : { playhead })}
      {...(playhead !== undefined && began !== undefined ? { epoch_s: began } : {})}
      origin={{
        of: runs.map(({ id }, n) => `${fillText(TEXTS.runOfChart, { run: id })}${markOf(n)}`).join(", "),
        plant: found === undefined ? TEXTS.plantUnknown : plantWord(found.plant),
        bank: describeBank(found?.settings.find((one) => one.name === "bank")?.value, banks),
      }}
      name={`sinew-run-${run}`}
      remark={
        <>
          {further === 1 && fillText(TEXTS.dotted, { run: (runs[1] as Recorded).id })}
          {further > 1 && runs.map(({ id }, n) => <Key key={id} n={n} of={runs.length} run={id} />)}
          {silent.length > 0 && fillText(TEXTS.runsWithoutSamples, { runs: silent.join(", ") })}
          <output aria-label={TEXTS.resolution}>{resolution}</output>
        </>
      }
    />
  );
}

function placed(mark: RunMark, angles: AngleUnit): PlacedMark {
  return {
    time_s: mark.t,
    text: localizeText(mark.text, angles),
    fault: mark.kind === "fault" || mark.kind === "trip",
    mode: mark.kind === "mode",
  };
}

/** Legend entry: line style and mark of a run. */
function Key({ n, of, run }: { n: number; of: number; run: number }) {
  return (
    <>
      <TraceLine trace={traceOf(MEASURED, n, of)} />
      {` ${markOf(n)} ${fillText(TEXTS.runOfChart, { run })} · `}
    </>
  );
}
