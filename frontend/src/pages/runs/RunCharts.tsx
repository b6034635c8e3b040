/** The samples of a stored run, or of two, on the same charts as the live ones; played back beside its actuator. */

import { useQuery } from "@tanstack/react-query";
import { useMemo, useState } from "react";
import { Charts } from "../../charts/Charts";
import { ComparedSource, comparedPanels } from "../../charts/comparedSource";
import type { PlacedMark } from "../../charts/decorations";
import { Playhead } from "../../charts/playhead";
import type { PlotSource } from "../../charts/source";
import { useViewport, type ViewControl } from "../../charts/useViewport";
import type { Viewport } from "../../charts/viewport";
import { useLive } from "../../live/react";
import { type Angles, inWords } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { runMarksQuery, runQuery } from "../../service/queries";
import { usePanels } from "../../theme/usePanels";
import type { RunMark } from "../../wire/types";
import { limitLines } from "../operate/limitLines";
import page from "../Page.module.css";
import { Replay } from "./Replay";
import replay from "./Replay.module.css";
import { useRecording } from "./useRecording";

const NO_MARKS: readonly RunMark[] = [];

export function RunCharts({ run, other }: { run: number; other?: number | undefined }) {
  const mine = useQuery(runQuery(run));
  const theirs = useQuery({ ...runQuery(other ?? run), enabled: other !== undefined });
  const error = mine.error ?? (other === undefined ? null : theirs.error);
  if (error) return <p className={page.empty}>{error.message}</p>;
  if (mine.data === undefined || (other !== undefined && theirs.data === undefined)) {
    return <p className={page.empty}>Loading …</p>;
  }
  if (mine.data.samples === 0) return <p className={page.empty}>This run has no samples.</p>;
  const { duration_s } = mine.data;
  if (other === undefined || theirs.data === undefined) {
    return <OneRun key={duration_s} run={run} duration_s={duration_s} />;
  }
  return (
    <TwoRuns
      key={`${duration_s} ${theirs.data.duration_s}`}
      run={run}
      duration_s={duration_s}
      other={other}
      other_s={theirs.data.duration_s}
    />
  );
}

function OneRun({ run, duration_s }: { run: number; duration_s: number }) {
  const home = useMemo(() => ({ span_s: duration_s, end_s: duration_s }), [duration_s]);
  const control = useViewport(home);
  const { source, resolution } = useRecording(run, duration_s, control.view);
  const [playhead] = useState(() => new Playhead());
  return (
    <div className={replay.beside}>
      <RecordedCharts
        run={run}
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

interface TwoRunsProps {
  readonly run: number;
  readonly duration_s: number;
  readonly other: number;
  readonly other_s: number;
}

function TwoRuns({ run, duration_s, other, other_s }: TwoRunsProps) {
  const longest_s = Math.max(duration_s, other_s);
  const home = useMemo(() => ({ span_s: longest_s, end_s: longest_s }), [longest_s]);
  const control = useViewport(home);
  const { source: first, resolution } = useRecording(run, duration_s, control.view);
  const { source: second } = useRecording(other, other_s, control.view);
  const source = useMemo(() => new ComparedSource(first, second), [first, second]);
  return (
    <RecordedCharts
      run={run}
      other={other}
      source={source}
      control={control}
      home={home}
      resolution={resolution}
    />
  );
}

interface RecordedChartsProps {
  readonly run: number;
  readonly other?: number;
  readonly source: PlotSource;
  readonly control: ViewControl;
  readonly home: Viewport;
  readonly playhead?: Playhead;
  readonly resolution: string;
}

function RecordedCharts({ run, other, source, control, home, playhead, resolution }: RecordedChartsProps) {
  const panels = usePanels();
  const angles = useAngles();
  const limits = useLive((live) => live.state?.limits);
  const { data: marks = NO_MARKS } = useQuery(runMarksQuery(run));
  return (
    <Charts
      panels={useMemo(() => (other === undefined ? panels : comparedPanels(panels)), [panels, other])}
      source={source}
      control={control}
      home={home}
      longest_s={home.span_s}
      limits={useMemo(() => limitLines(limits, angles), [limits, angles])}
      marks={useMemo(() => marks.map((mark) => placed(mark, angles)), [marks, angles])}
      stale={false}
      {...(playhead === undefined ? {} : { playhead })}
      name={`sinew-run-${run}`}
      remark={
        <>
          {other !== undefined && `dotted: run ${other} · `}
          <output aria-label="Resolution">{resolution}</output>
        </>
      }
    />
  );
}

function placed(mark: RunMark, angles: Angles): PlacedMark {
  return { time_s: mark.t, text: inWords(mark.text, angles), fault: mark.kind === "fault" };
}
