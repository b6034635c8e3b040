/** What a run will do to the rig, told before it starts. */

import { Verdict } from "../../components/Verdict";
import { duration, fixed, significant } from "../../samples/format";
import { readingOf } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import type { Prediction } from "../../wire/types";
import page from "../Page.module.css";
import styles from "./Identify.module.css";

interface PredictionViewProps {
  readonly prediction: Prediction | undefined;
  readonly problem: string | undefined;
}

export function PredictionView({ prediction, problem }: PredictionViewProps) {
  return (
    <output className={styles.prediction} aria-label="Prediction">
      {problem !== undefined && <Verdict good={false}>{problem}</Verdict>}
      {problem === undefined && prediction === undefined && <span className={page.dim}>Predicting …</span>}
      {problem === undefined && prediction !== undefined && (
        <>
          <dl className={page.facts}>
            {prediction.figures.map((figure) => (
              <Figure key={figure.name} {...figure} />
            ))}
            <dt>Length</dt>
            <dd>{duration(prediction.duration_s)}</dd>
          </dl>
          <Verdict good={prediction.enough_motion}>{prediction.message}</Verdict>
        </>
      )}
    </output>
  );
}

function Figure({ label, value, unit }: Prediction["figures"][number]) {
  const { unit: read, factor } = readingOf(unit, useAngles());
  const counts = unit === "encoder counts";
  return (
    <>
      <dt>{label}</dt>
      <dd>
        <strong>{counts ? fixed(value, 0) : significant(value === null ? null : value * factor, 3)}</strong>{" "}
        {read}
      </dd>
    </>
  );
}
