/** Predicted response to a unit step on the high-order model, with robustness beside it. */

import type { ReactNode } from "react";
import { Shown } from "../../components/Absent";
import { Explained } from "../../components/Explained";
import { SignalName } from "../../components/SignalName";
import { fixed, short } from "../../samples/format";
import { paintOf } from "../../theme/signals";
import type { LoopPreview } from "../../wire/types";
import styles from "./StepPreview.module.css";
import { stepPath } from "./stepPath";

const WIDTH = 150;
const HEIGHT = 46;
/** Room above the final value of a step. */
const UPPER = 1.15;
/** Robustness above this is out of the offered range. */
const M_S_LIMIT = 1.7;

interface StepPreviewProps {
  readonly symbol: string;
  readonly hue: string;
  readonly preview: LoopPreview | undefined;
  /** Why there is no preview where there is none. */
  readonly missing: string;
  /** What is in force, drawn beside a value that is not yet. */
  readonly present: LoopPreview | undefined;
  /** The value is not in force yet. */
  readonly drafted: boolean;
  /** Show what the printed formula of table 2 would do, beside it. */
  readonly compare: boolean;
}

export function StepPreview({ symbol, hue, preview, missing, present, drafted, compare }: StepPreviewProps) {
  const beside = drafted ? present : undefined;
  const end_s = Math.max(preview?.t.at(-1) ?? 0, beside?.t.at(-1) ?? 0);
  const upper = Math.max(UPPER, ...(preview?.y ?? []), ...(beside?.y ?? []));
  const drawing = preview === undefined ? null : stepPath(preview.t, preview.y, WIDTH, HEIGHT, upper, end_s);
  const printed = compare && preview !== undefined ? preview.printed : null;
  const M_s = preview?.M_s;
  const none = preview === undefined ? missing : "the loop is unstable";
  /** A margin that a stable loop does not have is no bound at all. */
  const margin = (value: number | null | undefined, told: (value: number) => string) => {
    if (preview?.stable && value === null) return "any";
    return (
      <Shown value={value} why={none}>
        {told}
      </Shown>
    );
  };
  const fragile = preview !== undefined && (M_s == null || M_s > M_S_LIMIT);
  return (
    // biome-ignore lint/a11y/useSemanticElements: readings, not inputs
    <div className={styles.preview} role="group" aria-label={`Preview of ${symbol}`} data-drafted={drafted}>
      <div className={styles.previewFrame}>
        <svg
          viewBox={`0 0 ${WIDTH} ${HEIGHT}`}
          className={styles.previewChart}
          preserveAspectRatio="none"
          aria-hidden="true"
        >
          {drawing && (
            <>
              <line
                className={styles.previewTarget}
                x1="0"
                x2={WIDTH}
                y1={drawing.target}
                y2={drawing.target}
              />
              {printed && (
                <path
                  className={styles.previewPrinted}
                  d={stepPath(preview?.t ?? [], printed.y, WIDTH, HEIGHT, drawing.top, end_s).path}
                  vectorEffect="non-scaling-stroke"
                />
              )}
              {beside && (
                <path
                  className={styles.previewPresent}
                  d={stepPath(beside.t, beside.y, WIDTH, HEIGHT, drawing.top, end_s).path}
                  vectorEffect="non-scaling-stroke"
                />
              )}
              <path d={drawing.path} stroke={paintOf(hue)} vectorEffect="non-scaling-stroke" />
            </>
          )}
        </svg>
        {drawing && (
          <>
            <span className={styles.previewOne} style={{ top: `${(100 * drawing.target) / HEIGHT}%` }}>
              1
            </span>
            <span className={styles.previewEnd}>{short(end_s)} s</span>
          </>
        )}
      </div>
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
        <Reading
          label={<SignalName name="t_90" />}
          name="time to 90 % of a step"
          value={
            <Shown
              value={drawing?.t_90}
              why={drawing === null ? none : "not reached in the time that is drawn"}
            >
              {(t_90) => fixed(t_90, 2)}
            </Shown>
          }
          unit="s"
        />
        <Reading
          label={<Explained of="quantity:gain_margin">GM</Explained>}
          name="gain margin"
          value={margin(preview?.gain_margin, (factor) => fixed(factor, 1))}
        />
        <Reading
          label={<Explained of="quantity:phase_margin_deg">PM</Explained>}
          name="phase margin"
          value={margin(preview?.phase_margin_deg, (degrees) => `${fixed(degrees, 0)}°`)}
        />
      </dl>
      {beside && (
        <span className="visually-hidden">
          In force, drawn grey: {timeTo90(stepPath(beside.t, beside.y, WIDTH, HEIGHT).t_90)}.
        </span>
      )}
      {printed && (
        <span className={styles.previewNote}>
          As printed: {printed.stable && printed.M_s !== null ? `M_s ${fixed(printed.M_s, 2)}` : "unstable"}{" "}
          (dotted; never in force)
        </span>
      )}
    </div>
  );
}

function timeTo90(t_90: number | null): string {
  return t_90 === null ? "90 % not reached in the time that is drawn" : `time to 90 % ${fixed(t_90, 2)} s`;
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
