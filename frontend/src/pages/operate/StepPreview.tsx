/** What one outer loop would do at the value in hand: how robust it is, and the motion that its λ sets. */

import type { ReactNode } from "react";
import { Shown } from "../../components/Absent";
import { Explained } from "../../components/Explained";
import { SignalName } from "../../components/SignalName";
import { fixed, short } from "../../samples/format";
import { paintOf } from "../../theme/signals";
import type { TuningPreview } from "../../wire/types";
import { type LoopName, previewedMotion } from "./previewedMotion";
import styles from "./StepPreview.module.css";
import { stepPath } from "./stepPath";

const WIDTH = 150;
const HEIGHT = 46;
/** Room above the final value of a step. */
const UPPER = 1.15;

interface StepPreviewProps {
  readonly symbol: string;
  readonly hue: string;
  readonly loop: LoopName;
  readonly preview: TuningPreview | undefined;
  /** The numbers belong to an earlier value. */
  readonly stale: boolean;
  /** Why there is no preview where there is none. */
  readonly missing: string;
  /** What is in force, drawn beside a value that is not yet. */
  readonly present: TuningPreview | undefined;
  /** The value is not in force yet. */
  readonly drafted: boolean;
  /** Show what the printed formula of table 2 would do, beside it. */
  readonly compare: boolean;
}

export function StepPreview(props: StepPreviewProps) {
  const { symbol, hue, loop, preview, stale, missing, present, drafted, compare } = props;
  const figures = preview?.[loop];
  const motion = preview && previewedMotion(preview, loop);
  const beside =
    drafted && present?.motion === preview?.motion ? present && previewedMotion(present, loop) : null;
  const printed = compare ? (figures?.printed ?? null) : null;
  const M_s = figures?.M_s;
  const none = preview === undefined ? missing : "the loop is unstable";
  /** A margin that a stable loop does not have is no bound at all. */
  const margin = (value: number | null | undefined, told: (value: number) => string) => {
    if (figures?.stable && value === null) return "any";
    return (
      <Shown value={value} why={none}>
        {told}
      </Shown>
    );
  };
  const fragile = figures !== undefined && (M_s == null || figures.lam < figures.lam_min);
  return (
    // biome-ignore lint/a11y/useSemanticElements: readings, not inputs
    <div
      className={styles.preview}
      role="group"
      aria-label={`Preview of ${symbol}`}
      aria-busy={stale}
      data-stale={stale}
      data-drafted={drafted}
    >
      {motion === null ? (
        <span className={styles.previewNote}>
          The trajectory sets the time of a step of {symbol === "λ_S" ? "S" : "q"}; {symbol} sets how robust
          the loop is.
        </span>
      ) : (
        <Drawing hue={hue} motion={motion} beside={beside} printed={printed} />
      )}
      <dl className={styles.previewNumbers}>
        <Reading
          label={<SignalName name="M_s" />}
          name="maximum of the sensitivity"
          value={
            <Shown value={M_s} why={none}>
              {(peak) => fixed(peak, 2)}
            </Shown>
          }
          warn={fragile}
        />
        {motion !== null && (
          <Reading
            label={motion?.kind === "push" ? "back" : <SignalName name="t_90" />}
            name={
              motion?.kind === "push" ? "time until the joint is back under a push" : "time to 90 % of a step"
            }
            value={
              <Shown
                value={motion?.time_s}
                why={preview === undefined ? none : "not within the time that is simulated"}
              >
                {(time_s) => fixed(time_s, 2)}
              </Shown>
            }
            unit="s"
          />
        )}
        <Reading
          label={<Explained of="quantity:gain_margin">GM</Explained>}
          name="gain margin"
          value={margin(figures?.gain_margin, (factor) => fixed(factor, 1))}
        />
        <Reading
          label={<Explained of="quantity:phase_margin_deg">PM</Explained>}
          name="phase margin"
          value={margin(figures?.phase_margin_deg, (degrees) => `${fixed(degrees, 0)}°`)}
        />
      </dl>
      {beside && (
        <span className="visually-hidden">In force, drawn grey: {timeOf(beside.kind, beside.time_s)}.</span>
      )}
      {printed && (
        <span className={styles.previewNote}>
          As printed: {printed.stable && printed.M_s !== null ? `M_s ${fixed(printed.M_s, 2)}` : "unstable"} (
          {printed.t.length > 0 ? "dotted; " : ""}never in force)
        </span>
      )}
    </div>
  );
}

type Motion = NonNullable<ReturnType<typeof previewedMotion>>;

interface DrawingProps {
  readonly hue: string;
  readonly motion: Motion | undefined;
  readonly beside: Motion | null | undefined;
  readonly printed: { readonly t: readonly number[]; readonly y: readonly number[] } | null;
}

function Drawing({ hue, motion, beside, printed }: DrawingProps) {
  const end_s = Math.max(motion?.t.at(-1) ?? 0, beside?.t.at(-1) ?? 0);
  const upper = Math.max(UPPER, ...(motion?.y ?? []), ...(beside?.y ?? []));
  const drawing = motion && stepPath(motion.t, motion.y, WIDTH, HEIGHT, upper, end_s);
  const target = HEIGHT * (1 - (motion?.target ?? 1) / upper);
  return (
    <div className={styles.previewFrame}>
      <svg
        viewBox={`0 0 ${WIDTH} ${HEIGHT}`}
        className={styles.previewChart}
        preserveAspectRatio="none"
        aria-hidden="true"
      >
        {drawing && (
          <>
            <line className={styles.previewTarget} x1="0" x2={WIDTH} y1={target} y2={target} />
            {printed && printed.t.length > 0 && (
              <path
                className={styles.previewPrinted}
                d={stepPath(printed.t, printed.y, WIDTH, HEIGHT, upper, end_s).path}
                vectorEffect="non-scaling-stroke"
              />
            )}
            {beside && (
              <path
                className={styles.previewPresent}
                d={stepPath(beside.t, beside.y, WIDTH, HEIGHT, upper, end_s).path}
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
            <span className={styles.previewOne} style={{ top: `${(100 * target) / HEIGHT}%` }}>
              1
            </span>
          )}
          <span className={styles.previewEnd}>{short(end_s)} s</span>
        </>
      )}
    </div>
  );
}

function timeOf(kind: Motion["kind"], time_s: number | null): string {
  if (kind === "push") return time_s === null ? "not back under a push" : `back after ${fixed(time_s, 2)} s`;
  return time_s === null
    ? "90 % not reached in the time that is simulated"
    : `time to 90 % ${fixed(time_s, 2)} s`;
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
        {value} <span className={styles.previewUnit}>{unit}</span>
      </dd>
    </div>
  );
}
