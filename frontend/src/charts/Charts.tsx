/** Chart workspace: panels over time and over signals, legends with values, cursors, and tools. */

import { ActionIcon, Button, Menu, Tooltip, useComputedColorScheme } from "@mantine/core";
import { useDisclosure, useElementSize, useHotkeys } from "@mantine/hooks";
import { type CSSProperties, type ReactNode, useCallback, useEffect, useMemo, useRef, useState } from "react";
import { TbCameraDown, TbChartHistogram, TbFileTypeCsv, TbRulerMeasure, TbSum } from "react-icons/tb";
import { Terms } from "../components/Explained";
import { fillText } from "../samples/texts";
import { usePreferences } from "../service/api/preferences";
import type { Panel } from "../theme/signals";
import { timeText } from "./axes";
import styles from "./Charts.module.css";
import type { LimitLine, PlacedMark } from "./decorations";
import { type Origin, type PictureKind, sheetNow, useSaving } from "./export";
import { type GestureTarget, inside, listen, steer, useWheelHint } from "./gestures";
import { LayoutTools } from "./LayoutEditor";
import { Legend } from "./Legend";
import { MeasureCursors } from "./PanelRow";
import { isPlane, PlaneFigure } from "./PlaneFigure";
import { ChartStack } from "./plot";
import { Readout } from "./readout";
import { SpectrumDialog, type SpectrumOrder } from "./SpectrumDialog";
import { RangeStatistics } from "./StatisticsTable";
import type { PlotSource } from "./sources";
import type { StoredData } from "./storedRuns";
import { TEXTS } from "./texts";
import {
  held,
  type Playhead,
  panned,
  useEnlarged,
  useEpoch,
  type ViewControl,
  type Viewport,
  visibleRange,
  zoomed,
} from "./viewport";

/** Tools for the visible range: cursors, statistics, spectrum, picture, data. */

interface ChartToolsProps {
  readonly measuring: boolean;
  readonly figures: boolean;
  /** Source whose every sample the service has; null if the page has all samples. */
  readonly dataOf: string | null;
  onMeasure(): void;
  onFigures(): void;
  onSpectrum(): void;
  onPicture(kind: PictureKind): void;
  onData(): void;
}

export function ChartTools(props: ChartToolsProps) {
  const { measuring, figures, dataOf, onMeasure, onFigures, onSpectrum, onPicture, onData } = props;
  return (
    <span className={styles.tools}>
      <Button
        px={8}
        variant={measuring ? "light" : "default"}
        aria-pressed={measuring}
        leftSection={<TbRulerMeasure size={14} />}
        onClick={onMeasure}
      >
        {TEXTS.measure}
      </Button>
      <Tool name={TEXTS.statistics} hint={TEXTS.statisticsHint} pressed={figures} onClick={onFigures}>
        <TbSum size={16} />
      </Tool>
      <Tool name={TEXTS.spectrum} hint={TEXTS.spectrumHint} onClick={onSpectrum}>
        <TbChartHistogram size={16} />
      </Tool>
      <Menu position="top" withinPortal>
        <Menu.Target>
          <ActionIcon
            variant="default"
            size={30}
            aria-label={TEXTS.savePicture}
            title={TEXTS.savePictureHint}
          >
            <TbCameraDown size={16} />
          </ActionIcon>
        </Menu.Target>
        <Menu.Dropdown>
          <Menu.Item onClick={() => onPicture("svg")}>{TEXTS.svg}</Menu.Item>
          <Menu.Item onClick={() => onPicture("pdf")}>{TEXTS.pdf}</Menu.Item>
          <Menu.Item onClick={() => onPicture("png")}>{TEXTS.png}</Menu.Item>
        </Menu.Dropdown>
      </Menu>
      <Tool
        name={TEXTS.saveData}
        hint={dataOf === null ? TEXTS.saveDataHint : fillText(TEXTS.saveStoredHint, { recording: dataOf })}
        onClick={onData}
      >
        <TbFileTypeCsv size={16} />
      </Tool>
    </span>
  );
}

interface ToolProps {
  readonly name: string;
  readonly hint: string;
  readonly pressed?: boolean;
  readonly children: ReactNode;
  onClick(): void;
}

function Tool({ name, hint, pressed, children, onClick }: ToolProps) {
  return (
    <Tooltip label={hint} position="top">
      <ActionIcon
        variant={pressed === true ? "light" : "default"}
        size={30}
        aria-label={name}
        {...(pressed === undefined ? {} : { "aria-pressed": pressed })}
        onClick={onClick}
      >
        {children}
      </ActionIcon>
    </Tooltip>
  );
}

interface ChartsProps {
  readonly panels: readonly Panel[];
  readonly source: PlotSource;
  readonly control: ViewControl;
  /** View after a double click. */
  readonly home: Viewport;
  readonly longest_s?: number;
  readonly limits: readonly LimitLine[];
  readonly marks: readonly PlacedMark[];
  /** Whether values are old and shown in grey. */
  readonly stale: boolean;
  /** Position in a recording: follows the pointer, and is shown without it. */
  readonly playhead?: Playhead;
  /** Source of the data, for the foot of pictures. */
  readonly origin: Origin;
  /** First part of the names of saved files. */
  readonly name: string;
  /** Time of day at time 0 [s since 1970]; omitted if there is none in common. */
  readonly epoch_s?: () => number;
  /** Data of the service with every sample; omitted if the page has all samples. */
  readonly stored?: StoredData;
  /** Whether the person cannot choose the panels. */
  readonly fixed?: boolean;
  /** Buttons before the tools. */
  readonly children?: ReactNode;
  /** Content at the end of the row of buttons. */
  readonly remark?: ReactNode;
}

export function Charts(props: ChartsProps) {
  const { source, control, home, longest_s, limits, marks, stale, playhead, name } = props;
  const { panels, enlarged, enlarge } = useEnlarged(props.panels);
  const stored = props.stored ?? null;
  const { change, current } = control;
  const scheme = useComputedColorScheme("light");
  const size = useElementSize();
  const hosts = useRef<(HTMLDivElement | null)[]>([]);
  const area = useRef<HTMLDivElement>(null);
  const frame = useRef<HTMLElement>(null);
  const { preferences, change: remember } = usePreferences();
  const hidden = useMemo(() => new Set(preferences.hidden), [preferences.hidden]);
  const timed = useMemo(() => panels.filter((panel) => !isPlane(panel)), [panels]);
  const planes = useMemo(() => panels.filter(isPlane), [panels]);
  const epoch = useEpoch(preferences.clock ? props.epoch_s : undefined);
  const [measuring, measure] = useDisclosure(false);
  const [spectrum, setSpectrum] = useState<SpectrumOrder | null>(null);
  useHotkeys([["m", measure.toggle]]);
  const formatTime = useCallback((time_s: number) => timeText(time_s, 0.001, epoch()), [epoch]);
  const readout = useMemo(
    () => new Readout(source, [...timed, ...planes], formatTime, stored, playhead),
    [source, timed, planes, formatTime, stored, playhead],
  );
  useEffect(() => () => readout.close(), [readout]);
  useEffect(() => readout.setMarks(marks), [readout, marks]);
  const seen = useCallback(() => visibleRange(current.current, source.now_s()), [current, source]);
  const readoutTime = useCallback(() => readout.readoutTime(seen()), [readout, seen]);
  const stack = useRef<ChartStack | null>(null);
  const [wheelHint, explainWheel] = useWheelHint();

  const target = useMemo<GestureTarget>(() => {
    const instant = (at: number) => {
      const { from_s, to_s } = seen();
      return from_s + at * (to_s - from_s);
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
  }, [source, readout, seen, change, current, home, longest_s, playhead, explainWheel]);

  // biome-ignore lint/correctness/useExhaustiveDependencies: a new colour scheme needs new colours on the canvases
  useEffect(() => {
    const elements = hosts.current.slice(0, timed.length).filter((host) => host !== null);
    const built = new ChartStack(
      elements,
      timed,
      source,
      () => current.current,
      epoch,
      (inSight) => readout.refresh(inSight),
    );
    stack.current = built;
    return () => {
      stack.current = null;
      built.destroy();
    };
  }, [timed, source, current, readout, epoch, scheme]);

  // biome-ignore lint/correctness/useExhaustiveDependencies: a new size, also of a legend, requires a resize
  useEffect(() => stack.current?.resize(), [size.width, size.height, measuring]);

  // biome-ignore lint/correctness/useExhaustiveDependencies: a rebuilt stack needs everything again
  useEffect(() => {
    stack.current?.setLimits(limits);
    stack.current?.setMarks(marks);
    for (const panel of timed) {
      for (const trace of panel.traces) stack.current?.show(trace.name, !hidden.has(trace.name));
    }
  }, [limits, marks, hidden, timed, source, readout, epoch, scheme]);

  useEffect(() => (area.current === null ? undefined : listen(area.current, target)), [target]);
  useEffect(() => readout.attach(frame.current), [readout]);

  useEffect(() => {
    if (measuring) {
      change(held(current.current, source.now_s()));
      readout.measure(seen());
    } else {
      readout.stopMeasuring();
    }
  }, [measuring, readout, source, seen, change, current]);

  const names = useMemo(() => {
    const drawn = panels.flatMap(({ traces, over }) => [...traces, ...(over === undefined ? [] : [over])]);
    return [...new Set(drawn.map((one) => one.name))];
  }, [panels]);
  const range = useCallback(() => readout.selection() ?? seen(), [readout, seen]);
  const selected = useCallback(() => source.table(names, range()), [source, names, range]);

  function toggle(signal: string): void {
    const others = preferences.hidden.filter((one) => one !== signal);
    remember({ hidden: others.length < preferences.hidden.length ? others : [...others, signal] });
  }

  const { savePicture, saveData, unsaved } = useSaving({
    name,
    names,
    stored,
    range,
    table: selected,
    sheet: () => {
      const drawn = { panels: timed, planes, hidden, source, limits, marks };
      return sheetNow({ ...drawn, seen: seen(), readout_s: readoutTime(), epoch_s: epoch() }, props.origin);
    },
  });

  function orderSpectrum(): void {
    setSpectrum({ range: range(), table: stored === null ? selected() : null, stored });
  }

  return (
    <section
      ref={frame}
      className={styles.stack}
      data-stale={stale}
      data-measuring={measuring}
      aria-label={TEXTS.charts}
    >
      <Terms>
        <div ref={size.ref} className={styles.body} style={{ flexGrow: heightOf(timed) }}>
          {timed.map((panel, index) => (
            <figure
              key={panel.title}
              className={styles.panel}
              aria-label={panel.title}
              data-last={index === timed.length - 1}
              data-panel={index}
              style={{ flexGrow: panel.share ?? 1, "--share": panel.share ?? 1 } as CSSProperties}
              // biome-ignore lint/a11y/noNoninteractiveTabindex: arrow keys pan and zoom the chart that has the focus
              tabIndex={0}
              onKeyDown={(event) => {
                if (event.target !== event.currentTarget) return;
                if (event.key === "Enter") enlarge(panel.title);
                else if (!steer(event.key, target)) return;
                event.preventDefault();
              }}
            >
              <Legend
                panel={panel}
                hidden={hidden}
                enlarged={enlarged === panel.title}
                {...(props.panels.length > 1 ? { onEnlarge: () => enlarge(panel.title) } : {})}
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
            {wheelHint && <span className={styles.hint}>{TEXTS.wheelHint}</span>}
            <MeasureCursors readout={readout} measuring={measuring} span_s={() => current.current.span_s} />
          </div>
        </div>
        {planes.length > 0 && (
          <div
            className={styles.planes}
            style={{ flexGrow: Math.max(...planes.map(({ share = 1 }) => share)) }}
          >
            {planes.map((plane, index) => (
              <PlaneFigure
                key={plane.title}
                plane={plane}
                place={timed.length + index}
                source={source}
                hidden={hidden}
                seen={seen}
                readoutTime={readoutTime}
                onToggle={toggle}
              />
            ))}
          </div>
        )}
        {preferences.statistics && (
          <RangeStatistics
            panels={panels}
            hidden={hidden}
            names={names}
            range={range}
            table={selected}
            stored={stored}
            timeText={formatTime}
          />
        )}
      </Terms>
      <div className={styles.toolbar} role="toolbar" aria-label={TEXTS.tools}>
        {props.children}
        {props.fixed !== true && <LayoutTools clock={props.epoch_s !== undefined} />}
        <ChartTools
          measuring={measuring}
          figures={preferences.statistics}
          onMeasure={measure.toggle}
          onFigures={() => remember({ statistics: !preferences.statistics })}
          onSpectrum={orderSpectrum}
          onPicture={(kind) => void savePicture(kind)}
          onData={saveData}
          dataOf={stored?.fileOf ?? null}
        />
        <output className={styles.deltaTime} data-role="delta-t" hidden={!measuring} />
        <span className={styles.toolbarEnd}>
          {unsaved !== null && <strong role="alert">{unsaved} </strong>}
          {props.remark}
        </span>
      </div>
      <SpectrumDialog
        panels={panels}
        order={spectrum}
        timeText={formatTime}
        onClose={() => setSpectrum(null)}
      />
    </section>
  );
}

function heightOf(panels: readonly Panel[]): number {
  return panels.reduce((sum, { share = 1 }) => sum + share, 0);
}
