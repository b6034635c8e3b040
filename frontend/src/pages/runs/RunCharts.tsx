/** The samples of a stored run, or of several, on the same charts as the live ones; played back beside its actuator. */

import { useQueries, useQuery } from "@tanstack/react-query";
import { useMemo, useState } from "react";
import { Charts } from "../../charts/Charts";
import { ComparedSource, comparedPanels, markOf, traceOf } from "../../charts/comparedSource";
import type { PlacedMark } from "../../charts/decorations";
import { Playhead } from "../../charts/playhead";
import { ShiftedSource } from "../../charts/shiftedSource";
import type { PlotSource } from "../../charts/source";
import { StoredRuns } from "../../charts/storedRuns";
import { TraceLine } from "../../charts/TraceLine";
import { useViewport, type ViewControl } from "../../charts/useViewport";
import type { Viewport } from "../../charts/viewport";
import { plantWord } from "../../components/PlantBadge";
import { useLive } from "../../live/react";
import { type Angles, inWords } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { banksQuery, runMarksQuery, runQuery } from "../../service/queries";
import { bankInWords } from "../../service/tuningWords";
import { HUES, type Trace } from "../../theme/signals";
import { usePanels } from "../../theme/usePanels";
import type { Bank, RunMark } from "../../wire/types";
import { limitLines } from "../operate/limitLines";
import page from "../Page.module.css";
import { Replay } from "./Replay";
import replay from "./Replay.module.css";
import { covered, type Recorded, useRecordings } from "./useRecordings";

const NO_MARKS: readonly RunMark[] = [];

const NO_BANKS: readonly Bank[] = [];
const NO_OTHERS: readonly number[] = [];

/** What the pieces of curves in the key are of. */
const MEASURED: Trace = { name: "q", hue: HUES.q, dashed: false };

interface RunChartsProps {
  readonly run: number;
  /** Where the playhead stands first. */
  readonly at_s?: number | null;
  readonly others?: readonly number[];
  /** Of runs beside each other: what brings each onto the axis of the reference, whose marks are shown. */
  readonly placed?: Placed;
}

/** Runs without an offset are left out. */
export interface Placed {
  readonly reference: number;
  readonly offsets: ReadonlyMap<number, number>;
}

/** `others` has to be the same array as long as it says the same. */
export function RunCharts({ run, at_s = null, others = NO_OTHERS, placed }: RunChartsProps) {
  const asked = useQueries({ queries: [run, ...others].map((id) => runQuery(id)) });
  const error = asked.find((one) => one.error)?.error;
  if (error) return <p className={page.empty}>{error.message}</p>;
  const found = asked.map(({ data }) => data).filter((data) => data !== undefined);
  if (found.length < asked.length) return <p className={page.empty}>Loading …</p>;
  const silent = found.filter(({ samples }) => samples === 0).map(({ id }) => id);
  if (silent.includes(run) && placed === undefined) {
    return <p className={page.empty}>This run has no samples.</p>;
  }
  const drawn = found
    .filter(({ id, samples }) => samples > 0 && (placed === undefined || placed.offsets.has(id)))
    .map(({ id, duration_s }) => ({ id, duration_s, offset_s: placed?.offsets.get(id) ?? 0 }));
  const key = drawn.map(({ id, duration_s, offset_s }) => `${id}:${duration_s}:${offset_s}`).join(" ");
  if (drawn.length === 0) return <p className={page.empty}>None of these runs can be drawn.</p>;
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
    <div className={replay.beside}>
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

/** Seconds in sight of a long recording that is looked at for one moment. */
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

/** Mounted anew for other runs: these stay what they are. */
function SeveralRuns({ runs, silent, reference }: SeveralRunsProps) {
  const [kept] = useState(runs);
  const home = useMemo(() => {
    const { from_s, to_s } = covered(kept);
    return { span_s: to_s - from_s, end_s: to_s };
  }, [kept]);
  const control = useViewport(home);
  const { sources, resolution } = useRecordings(kept, control.view);
  const source = useMemo(
    () => new ComparedSource(...sources.map((own, n) => new ShiftedSource(own, kept[n]?.offset_s ?? 0))),
    [sources, kept],
  );
  return (
    <RecordedCharts
      runs={kept}
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
  /** Runs that were asked for and have no samples. */
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
  const angles = useAngles();
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
        of: runs.map(({ id }, n) => `run ${id}${markOf(n)}`).join(", "),
        plant: found === undefined ? "plant not known" : plantWord(found.plant),
        bank: bankInWords(found?.settings.find((one) => one.name === "bank")?.value, banks),
      }}
      name={`sinew-run-${run}`}
      remark={
        <>
          {further === 1 && `dotted: run ${runs[1]?.id} · `}
          {further > 1 && runs.map(({ id }, n) => <Key key={id} n={n} of={runs.length} run={id} />)}
          {silent.length > 0 && `without samples: run ${silent.join(", ")} · `}
          <output aria-label="Resolution">{resolution}</output>
        </>
      }
    />
  );
}

function placed(mark: RunMark, angles: Angles): PlacedMark {
  return {
    time_s: mark.t,
    text: inWords(mark.text, angles),
    fault: mark.kind === "fault" || mark.kind === "trip",
    mode: mark.kind === "mode",
  };
}

/** Which curves are of which run. */
function Key({ n, of, run }: { n: number; of: number; run: number }) {
  return (
    <>
      <TraceLine trace={traceOf(MEASURED, n, of)} />
      {` ${markOf(n)} run ${run} · `}
    </>
  );
}
