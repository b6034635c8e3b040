import { useQuery } from "@tanstack/react-query";
import type { ReactNode } from "react";
import { Explained } from "../../components/Explained";
import { SignalName, ValueOrReason } from "../../components/values";
import { fixed, short } from "../../samples/format";
import { readingOf, withUnit } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { useAngleUnit } from "../../service/api/preferences";
import { plannedQuery } from "../../service/api/runs";
import { paintOf, traceFor } from "../../theme/signals";
import type { Planned, TuningPreview } from "../../wire/types";
import plannedProfileStyles from "./PlannedProfile.module.css";
import stepPreviewStyles from "./StepPreview.module.css";
import { TEXTS } from "./texts";

/** Motion that a λ determines: a step (`lambda`) or the return from a push (`time-optimal`). Pure. */

export type LoopName = "position" | "stiffness";

interface PreviewedMotion {
  readonly kind: "step" | "push";
  /** Time [s]. */
  readonly t: readonly number[];
  /** Progress of the step from 0 to 1, or deflection under the push relative to the largest one. */
  readonly y: readonly number[];
  /** End of the motion in the unit of `y`: the new reference, or the edge of the return band. */
  readonly target: number;
  /** Time to 90 % of the step, or to the return into the band [s]; null if not reached. */
  readonly time_s: number | null;
}

/** Returns null in time-optimal motion of S: the trajectory makes the steps, and a push does not move S. */
function previewedMotion(preview: TuningPreview, loop: LoopName): PreviewedMotion | null {
  if (preview.motion === "lambda") {
    const { t, y, rise_s } = loop === "position" ? preview.step_q : preview.step_S;
    return { kind: "step", t, y, target: 1, time_s: rise_s };
  }
  if (loop === "stiffness") return null;
  const { near, without, rejected } = preview.pushed;
  const { t, off, give, back_s } = rejected ?? without;
  const largest = give > 0 ? give : 1;
  return { kind: "push", t, y: off.map((value) => value / largest), target: near / largest, time_s: back_s };
}

/** Computes the SVG path of a step response. Pure. */

interface StepDrawing {
  readonly path: string;
  /** y coordinate of the final value 1 in the drawing. */
  readonly target: number;
  /** Value at the upper edge. */
  readonly top: number;
  /** First time at 90 % [s]; null if not reached. */
  readonly t_90: number | null;
}

const TOP = 1.15;

/** Draws the response `y(t)` from 0 to at least 1.15, or to `upper`.
 * `end_s` sets a common time axis for two responses; the last value continues up to it. */
export function stepPath(
  t: readonly number[],
  y: readonly number[],
  width: number,
  height: number,
  upper?: number,
  end_s?: number,
): StepDrawing {
  const last = end_s ?? t.at(-1) ?? 1;
  const top = upper ?? Math.max(TOP, ...y);
  const level = (value: number) => height - (value / top) * height;
  const points = t.map(
    (time, index) => `${((time / last) * width).toFixed(1)} ${level(y[index] ?? 0).toFixed(1)}`,
  );
  if ((t.at(-1) ?? last) < last) points.push(`${width.toFixed(1)} ${level(y.at(-1) ?? 0).toFixed(1)}`);
  return {
    path: points.length === 0 ? "" : `M${points.join("L")}`,
    target: level(1),
    top,
    t_90: firstAt(0.9, t, y),
  };
}

/** Returns the first time at which `y` reaches `level`, by linear interpolation; null if never. */
function firstAt(level: number, t: readonly number[], y: readonly number[]): number | null {
  const above = y.findIndex((value) => value >= level);
  const [t0, t1, y0, y1] = [t[above - 1], t[above], y[above - 1], y[above]];
  if (t1 === undefined || y1 === undefined) {
    return null;
  }
  return t0 === undefined || y0 === undefined ? t1 : t0 + ((level - y0) / (y1 - y0)) * (t1 - t0);
}

/** Preview of one outer loop at the edited value: margins, and the motion that its λ determines. */

const WIDTH = 150;
const HEIGHT = 46;
/** Least upper edge of the drawing, relative to the final value of a step. */
const UPPER = 1.15;

interface StepPreviewProps {
  readonly symbol: string;
  readonly hue: string;
  readonly loop: LoopName;
  readonly preview: TuningPreview | undefined;
  /** The numbers belong to an earlier value. */
  readonly stale: boolean;
  /** Reason for a missing preview. */
  readonly missing: string;
  /** Preview of the active tuning, drawn for comparison with an edited value. */
  readonly present: TuningPreview | undefined;
  /** The value is not active yet. */
  readonly drafted: boolean;
  /** Also shows the response with the formula as printed in table 2. */
  readonly compare: boolean;
}

export function StepPreview(props: StepPreviewProps) {
  const { symbol, hue, loop, preview, stale, missing, present, drafted, compare } = props;
  const figures = preview?.[loop];
  const motion = preview && previewedMotion(preview, loop);
  const activeMotion =
    drafted && present?.motion === preview?.motion ? present && previewedMotion(present, loop) : null;
  const printed = compare ? (figures?.printed ?? null) : null;
  const M_s = figures?.M_s;
  const none = preview === undefined ? missing : TEXTS.loopUnstable;
  /** A stable loop with margin null has an unlimited margin. */
  const margin = (value: number | null | undefined, format: (value: number) => string) => {
    if (figures?.stable && value === null) return TEXTS.noMargin;
    return (
      <ValueOrReason value={value} why={none}>
        {format}
      </ValueOrReason>
    );
  };
  const fragile = figures !== undefined && (M_s == null || figures.lam < figures.lam_min);
  return (
    // biome-ignore lint/a11y/useSemanticElements: readings, not inputs
    <div
      className={stepPreviewStyles.preview}
      role="group"
      aria-label={fillText(TEXTS.preview, { symbol })}
      aria-busy={stale}
      data-stale={stale}
      data-drafted={drafted}
    >
      {motion === null ? (
        <span className={stepPreviewStyles.previewNote}>
          {fillText(TEXTS.stepTimeOfTrajectory, { signal: symbol === "λ_S" ? "S" : "q", symbol })}
        </span>
      ) : (
        <Drawing hue={hue} motion={motion} activeMotion={activeMotion} printed={printed} />
      )}
      <dl className={stepPreviewStyles.previewNumbers}>
        <Reading
          label={<SignalName name="M_s" />}
          name={TEXTS.sensitivityPeak}
          value={
            <ValueOrReason value={M_s} why={none}>
              {(peak) => fixed(peak, 2)}
            </ValueOrReason>
          }
          warn={fragile}
        />
        {motion !== null && (
          <Reading
            label={motion?.kind === "push" ? TEXTS.returnLabel : <SignalName name="t_90" />}
            name={motion?.kind === "push" ? TEXTS.returnTime : TEXTS.timeTo90}
            value={
              <ValueOrReason
                value={motion?.time_s}
                why={preview === undefined ? none : TEXTS.notInSimulatedTime}
              >
                {(time_s) => fixed(time_s, 2)}
              </ValueOrReason>
            }
            unit="s"
          />
        )}
        <Reading
          label={<Explained of="quantity:gain_margin">GM</Explained>}
          name={TEXTS.gainMargin}
          value={margin(figures?.gain_margin, (factor) => fixed(factor, 1))}
        />
        <Reading
          label={<Explained of="quantity:phase_margin_deg">PM</Explained>}
          name={TEXTS.phaseMargin}
          value={margin(figures?.phase_margin_deg, (degrees) => `${fixed(degrees, 0)}°`)}
        />
      </dl>
      {activeMotion && (
        <span className="visually-hidden">
          {fillText(TEXTS.activeInGrey, { motion: timeOf(activeMotion.kind, activeMotion.time_s) })}
        </span>
      )}
      {printed && (
        <span className={stepPreviewStyles.previewNote}>
          {fillText(printed.t.length > 0 ? TEXTS.asPrintedDotted : TEXTS.asPrinted, {
            value: printed.stable && printed.M_s !== null ? `M_s ${fixed(printed.M_s, 2)}` : TEXTS.unstable,
          })}
        </span>
      )}
    </div>
  );
}

type Motion = NonNullable<ReturnType<typeof previewedMotion>>;

interface DrawingProps {
  readonly hue: string;
  readonly motion: Motion | undefined;
  readonly activeMotion: Motion | null | undefined;
  readonly printed: { readonly t: readonly number[]; readonly y: readonly number[] } | null;
}

function Drawing({ hue, motion, activeMotion, printed }: DrawingProps) {
  const end_s = Math.max(motion?.t.at(-1) ?? 0, activeMotion?.t.at(-1) ?? 0);
  const upper = Math.max(UPPER, ...(motion?.y ?? []), ...(activeMotion?.y ?? []));
  const drawing = motion && stepPath(motion.t, motion.y, WIDTH, HEIGHT, upper, end_s);
  const target = HEIGHT * (1 - (motion?.target ?? 1) / upper);
  return (
    <div className={stepPreviewStyles.previewFrame}>
      <svg
        viewBox={`0 0 ${WIDTH} ${HEIGHT}`}
        className={stepPreviewStyles.previewChart}
        preserveAspectRatio="none"
        aria-hidden="true"
      >
        {drawing && (
          <>
            <line className={stepPreviewStyles.previewTarget} x1="0" x2={WIDTH} y1={target} y2={target} />
            {printed && printed.t.length > 0 && (
              <path
                className={stepPreviewStyles.previewPrinted}
                d={stepPath(printed.t, printed.y, WIDTH, HEIGHT, upper, end_s).path}
                vectorEffect="non-scaling-stroke"
              />
            )}
            {activeMotion && (
              <path
                className={stepPreviewStyles.previewPresent}
                d={stepPath(activeMotion.t, activeMotion.y, WIDTH, HEIGHT, upper, end_s).path}
                vectorEffect="non-scaling-stroke"
              />
            )}
            <path d={drawing.path} stroke={paintOf(hue)} vectorEffect="non-scaling-stroke" />
          </>
        )}
      </svg>
      {motion && (
        <>
          {motion.kind === "step" && (
            <span className={stepPreviewStyles.previewOne} style={{ top: `${(100 * target) / HEIGHT}%` }}>
              1
            </span>
          )}
          <span className={stepPreviewStyles.previewEnd}>{short(end_s)} s</span>
        </>
      )}
    </div>
  );
}

function timeOf(kind: Motion["kind"], time_s: number | null): string {
  const isPush = kind === "push";
  if (time_s === null) return isPush ? TEXTS.noReturn : TEXTS.no90;
  return fillText(isPush ? TEXTS.returnAfter : TEXTS.at90, { time: fixed(time_s, 2) });
}

interface ReadingProps {
  readonly label: ReactNode;
  readonly name: string;
  readonly value: ReactNode;
  readonly unit?: string;
  readonly warn?: boolean;
}

function Reading({ label, name, value, unit = "", warn = false }: ReadingProps) {
  return (
    <div data-warn={warn}>
      <dt>
        {label}
        <span className="visually-hidden">, {name}</span>
      </dt>
      <dd>
        {value} <span className={stepPreviewStyles.previewUnit}>{unit}</span>
      </dd>
    </div>
  );
}

/** Computes the lines of the planned profile within a box of PROFILE_WIDTH × PROFILE_HEIGHT. Pure. */

interface Line {
  /** Points of the SVG polylines. */
  readonly pieces: readonly string[];
  readonly lowest: number;
  readonly highest: number;
}

export const PROFILE_WIDTH = 1000;
export const PROFILE_HEIGHT = 40;
const MARGIN = 3;

/** Returns the line of a signal: at half height if constant, with gaps where the program leaves it open. */
export function lineOf(t: readonly number[], values: readonly (number | null)[]): Line {
  const given = values.filter((value) => value !== null);
  const lowest = Math.min(...given);
  const highest = Math.max(...given);
  const whole_s = t[t.length - 1] ?? 0;
  const span = highest - lowest;
  const pieces: string[][] = [[]];
  values.forEach((value, at) => {
    if (value === null) {
      if (pieces[pieces.length - 1]?.length !== 0) pieces.push([]);
      return;
    }
    const up = span === 0 ? 0.5 : (value - lowest) / span;
    const x = whole_s === 0 ? 0 : (PROFILE_WIDTH * (t[at] ?? 0)) / whole_s;
    const point = `${x.toFixed(1)},${(MARGIN + (PROFILE_HEIGHT - 2 * MARGIN) * (1 - up)).toFixed(1)}`;
    pieces[pieces.length - 1]?.push(point);
  });
  return {
    pieces: pieces.filter((piece) => piece.length > 0).map((piece) => piece.join(" ")),
    lowest,
    highest,
  };
}

/** Returns the x coordinate of a time, limited to the box. */
export function placeOf(t: readonly number[], at_s: number): number {
  const whole_s = t[t.length - 1] ?? 0;
  return whole_s === 0 ? 0 : PROFILE_WIDTH * Math.min(1, Math.max(0, at_s / whole_s));
}

/** Returns the last value at or before a time; null where the program leaves the signal open. */
export function valueAt(t: readonly number[], values: readonly (number | null)[], at_s: number) {
  const after = t.findIndex((one) => one > at_s + 1e-9);
  return values[after === -1 ? t.length - 1 : Math.max(0, after - 1)] ?? null;
}

/** Planned signals of a run's program, with a line at the current time. */

/** Samples are stored once a second. */
const STORED_AFTER_S = 2;

export function PlannedProfile({ run, at_s }: { run: number; at_s: number }) {
  const { data } = useQuery(plannedQuery(run, at_s > STORED_AFTER_S));
  if (data === undefined || data.t.length === 0) return null;
  return (
    <figure className={plannedProfileStyles.profile} aria-label={TEXTS.plannedProfile}>
      {data.lines.map((line) => (
        <Row key={line.name} planned={data} line={line} at_s={at_s} />
      ))}
    </figure>
  );
}

interface RowProps {
  readonly planned: Planned;
  readonly line: Planned["lines"][number];
  readonly at_s: number;
}

function Row({ planned, line: { name, unit: inSI, values }, at_s }: RowProps) {
  const { unit, factor } = readingOf(inSI, useAngleUnit());
  const { pieces, lowest, highest } = lineOf(
    planned.t,
    values.map((value) => (value === null ? null : value * factor)),
  );
  const now = valueAt(planned.t, values, at_s);
  const x = placeOf(planned.t, at_s);
  const whole_s = planned.t[planned.t.length - 1] ?? 1;
  const { hue } = traceFor(name, []);
  return (
    <div className={plannedProfileStyles.row}>
      <span className={plannedProfileStyles.name}>
        <SignalName name={name} /> [{unit}]
      </span>
      <svg
        className={plannedProfileStyles.picture}
        viewBox={`0 0 ${PROFILE_WIDTH} ${PROFILE_HEIGHT}`}
        preserveAspectRatio="none"
        role="img"
        aria-label={fillText(TEXTS.profileOf, {
          name,
          lowest: fixed(lowest, 1),
          highest: withUnit(fixed(highest, 1), unit),
          now: now === null ? TEXTS.notSpecified : withUnit(fixed(now * factor, 1), unit),
        })}
      >
        {planned.parts.slice(1).map((part) => (
          <line
            key={part.start_s}
            className={plannedProfileStyles.part}
            x1={(PROFILE_WIDTH * part.start_s) / whole_s}
            x2={(PROFILE_WIDTH * part.start_s) / whole_s}
            y1="0"
            y2={PROFILE_HEIGHT}
          />
        ))}
        <rect className={plannedProfileStyles.past} x="0" y="0" width={x} height={PROFILE_HEIGHT} />
        {pieces.map((points) => (
          <polyline
            key={points.slice(0, 20)}
            className={plannedProfileStyles.line}
            points={points}
            stroke={paintOf(hue)}
          />
        ))}
        <line className={plannedProfileStyles.now} x1={x} x2={x} y1="0" y2={PROFILE_HEIGHT} />
      </svg>
      <span className={plannedProfileStyles.range}>
        {fixed(highest, 1)}
        <br />
        {fixed(lowest, 1)}
      </span>
    </div>
  );
}
