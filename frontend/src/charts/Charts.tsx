/** A stack of charts with legends that read out values, one shared cursor, two measuring cursors, and tools below. */

import { useComputedColorScheme } from "@mantine/core";
import { useDisclosure, useElementSize, useHotkeys } from "@mantine/hooks";
import { type ReactNode, useCallback, useEffect, useMemo, useRef, useState } from "react";
import { Terms } from "../components/Terms";
import { clockTime } from "../samples/format";
import { type SampleTable, toCsv } from "../samples/table";
import { usePreferences } from "../service/preferences";
import { type Panel, unitOf } from "../theme/signals";
import styles from "./Charts.module.css";
import { ChartTools } from "./ChartTools";
import { readColours } from "./colours";
import type { LimitLine, PlacedMark } from "./decorations";
import { type GestureTarget, listen, steer } from "./gestures";
import { Legend } from "./Legend";
import { stackPicture } from "./picture";
import type { Playhead } from "./playhead";
import { Readout } from "./readout";
import { SpectrumDialog } from "./SpectrumDialog";
import { StatisticsTable } from "./StatisticsTable";
import { save, stamp } from "./save";
import type { PlotSource } from "./source";
import { ChartStack } from "./stack";
import type { ViewControl } from "./useViewport";
import { useWheelHint, WHEEL_HINT } from "./useWheelHint";
import { held, panned, type Viewport, zoomed } from "./viewport";

interface ChartsProps {
  readonly panels: readonly Panel[];
  readonly source: PlotSource;
  readonly control: ViewControl;
  /** Where a double click leads. */
  readonly home: Viewport;
  readonly longest_s?: number;
  /** By the title of the panel. */
  readonly limits: ReadonlyMap<string, readonly LimitLine[]>;
  readonly marks: readonly PlacedMark[];
  /** Values are old: shown grey. */
  readonly stale: boolean;
  /** Of a recording: follows the pointer, and shows where it stands otherwise. */
  readonly playhead?: Playhead;
  /** Begin of the names of saved files. */
  readonly name: string;
  /** Buttons before the tools. */
  readonly children?: ReactNode;
  /** At the end of the row of buttons. */
  readonly remark?: ReactNode;
}

export function Charts(props: ChartsProps) {
  const { panels, source, control, home, longest_s, limits, marks, stale, playhead, name, children, remark } =
    props;
  const { change, current } = control;
  const scheme = useComputedColorScheme("light");
  const size = useElementSize();
  const hosts = useRef<(HTMLDivElement | null)[]>([]);
  const area = useRef<HTMLDivElement>(null);
  const frame = useRef<HTMLElement>(null);
  const { preferences, change: remember } = usePreferences();
  const hidden = useMemo(() => new Set(preferences.hidden), [preferences.hidden]);
  const [measuring, measure] = useDisclosure(false);
  const [spectrum, setSpectrum] = useState<SampleTable | null>(null);
  useHotkeys([["m", measure.toggle]]);
  const readout = useMemo(() => new Readout(source, panels, playhead), [source, panels, playhead]);
  const stack = useRef<ChartStack | null>(null);
  const [wheelHint, explainWheel] = useWheelHint();

  const target = useMemo<GestureTarget>(() => {
    const instant = (at: number) => {
      const seen = stack.current?.seen() ?? { from_s: 0, to_s: 0 };
      return seen.from_s + at * (seen.to_s - seen.from_s);
    };
    return {
      zoomTime: (factor, at) => change(zoomed(current.current, factor, instant(at), longest_s)),
      zoomValues: (factor, clientY) => {
        const index = hosts.current.findIndex((host) => host !== null && inside(host, clientY));
        const box = hosts.current[index]?.getBoundingClientRect();
        if (box !== undefined) stack.current?.scaleValues(index, factor, (box.bottom - clientY) / box.height);
      },
      pan: (by) => {
        const view = current.current;
        change(panned(view, -by * view.span_s, source.first_s(), source.now_s()));
      },
      reset: () => {
        stack.current?.resetValues();
        change(home);
      },
      leftToScroll: explainWheel,
      hover: (at) => {
        readout.hover(at);
        if (at !== null && playhead?.playing === false) playhead.set(instant(at));
      },
      grab: (at) => readout.grab(instant(at), current.current.span_s),
      move: (cursor, at) => readout.move(cursor, instant(at)),
    };
  }, [source, readout, change, current, home, longest_s, playhead, explainWheel]);

  // biome-ignore lint/correctness/useExhaustiveDependencies: a new colour scheme needs new colours on the canvases
  useEffect(() => {
    const elements = hosts.current.filter((host) => host !== null);
    const built = new ChartStack(
      elements,
      panels,
      source,
      () => current.current,
      (seen) => readout.refresh(seen),
    );
    stack.current = built;
    return () => {
      stack.current = null;
      built.destroy();
    };
  }, [panels, source, current, readout, scheme]);

  // biome-ignore lint/correctness/useExhaustiveDependencies: the size, or that of a legend, is the reason to measure again
  useEffect(() => stack.current?.resize(), [size.width, size.height, measuring]);

  // biome-ignore lint/correctness/useExhaustiveDependencies: a rebuilt stack needs everything again
  useEffect(() => {
    stack.current?.setLimits(limits);
    stack.current?.setMarks(marks);
    for (const panel of panels) {
      for (const trace of panel.traces) stack.current?.show(trace.name, !hidden.has(trace.name));
    }
  }, [limits, marks, hidden, panels, source, scheme]);

  useEffect(() => (area.current === null ? undefined : listen(area.current, target)), [target]);
  useEffect(() => readout.attach(frame.current), [readout]);

  useEffect(() => {
    if (measuring) {
      change(held(current.current, source.now_s()));
      const seen = stack.current?.seen();
      if (seen !== undefined) readout.measure(seen);
    } else {
      readout.stopMeasuring();
    }
  }, [measuring, readout, source, change, current]);

  const names = useMemo(
    () => panels.flatMap((panel) => panel.traces.map((trace) => trace.name as string)),
    [panels],
  );
  const selected = useCallback(
    () => source.table(names, readout.selection() ?? stack.current?.seen() ?? { from_s: 0, to_s: 0 }),
    [source, names, readout],
  );

  function toggle(signal: string): void {
    const kept = preferences.hidden.filter((one) => one !== signal);
    remember({ hidden: kept.length < preferences.hidden.length ? kept : [...kept, signal] });
  }

  function savePicture(): void {
    const [built, element] = [stack.current, frame.current];
    if (built === null || element === null) return;
    const { from_s, to_s } = built.seen();
    const foot = `${name}, ${clockTime(from_s, 0.001)} to ${clockTime(to_s, 0.001)}, saved ${stamp(new Date())}`;
    const picture = stackPicture(panels, built.canvases, hidden, readColours(element), foot);
    picture.toBlob((content) => content && save(content, `${name}-${stamp(new Date())}.png`));
  }

  function saveData(): void {
    const content = toCsv(selected(), unitOf);
    save(new Blob([content], { type: "text/csv" }), `${name}-${stamp(new Date())}.csv`);
  }

  return (
    <section
      ref={frame}
      className={styles.stack}
      data-stale={stale}
      data-measuring={measuring}
      aria-label="Charts"
    >
      <Terms>
        <div ref={size.ref} className={styles.body}>
          {panels.map((panel, index) => (
            <figure
              key={panel.title}
              className={styles.panel}
              aria-label={panel.title}
              data-last={index === panels.length - 1}
              // biome-ignore lint/a11y/noNoninteractiveTabindex: arrow keys pan and zoom the chart that has the focus
              tabIndex={0}
              onKeyDown={(event) => {
                if (event.target === event.currentTarget && steer(event.key, target)) event.preventDefault();
              }}
            >
              <Legend
                panel={panel}
                hidden={hidden}
                onToggle={toggle}
                onHighlight={(signal) => stack.current?.highlight(signal)}
              />
              <div
                className={styles.host}
                ref={(element) => {
                  hosts.current[index] = element;
                }}
              />
            </figure>
          ))}
          <div ref={area} className={styles.area}>
            <div className={styles.cursor} data-role="hover" />
            {([0, 1] as const).map((cursor) => (
              <div
                key={cursor}
                className={styles.measure}
                data-role={`cursor-${cursor}`}
                role="slider"
                aria-label={`Measuring cursor ${cursor + 1} [s]`}
                aria-valuenow={0}
                tabIndex={measuring ? 0 : -1}
                onKeyDown={(event) => {
                  const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
                  if (by === undefined) return;
                  event.preventDefault();
                  const share = event.shiftKey ? 0.1 : 0.005;
                  readout.nudge(cursor, by * share, current.current.span_s);
                }}
              />
            ))}
          </div>
        </div>
        {preferences.statistics && <StatisticsTable panels={panels} hidden={hidden} table={selected} />}
      </Terms>
      <div className={styles.toolbar} role="toolbar" aria-label="Chart tools">
        {children}
        <ChartTools
          measuring={measuring}
          figures={preferences.statistics}
          onMeasure={measure.toggle}
          onFigures={() => remember({ statistics: !preferences.statistics })}
          onSpectrum={() => setSpectrum(selected())}
          onPicture={savePicture}
          onData={saveData}
        />
        <output className={styles.deltaTime} data-role="delta-t" hidden={!measuring} />
        <span className={styles.toolbarEnd}>{wheelHint ? WHEEL_HINT : remark}</span>
      </div>
      <SpectrumDialog panels={panels} table={spectrum} onClose={() => setSpectrum(null)} />
    </section>
  );
}

function inside(element: HTMLElement, clientY: number): boolean {
  const box = element.getBoundingClientRect();
  return clientY >= box.top && clientY <= box.bottom;
}
