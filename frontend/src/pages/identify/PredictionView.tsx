/** What a run will do to the rig, told before it starts. */

import { Shown } from "../../components/Absent";
import { Card } from "../../components/Card";
import { Verdict } from "../../components/Verdict";
import { useLive } from "../../live/react";
import { duration, fixed, significant } from "../../samples/format";
import { angleText, inWords, labelWith, readingOf } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import type { Prediction } from "../../wire/types";
import page from "../Page.module.css";
import { ForecastMap } from "./ForecastMap";
import styles from "./Identify.module.css";

export interface LocalizedText {
  readonly prediction: Prediction | undefined;
  readonly problem: string | undefined;
}

export function PredictionView({ prediction, problem }: LocalizedText) {
  const angles = useAngles();
  const isRunning = useLive((live) => live.state?.task != null);
  if (isRunning) {
    return (
      <Card title="Forecast">
        <output className={styles.prediction} aria-label="Prediction">
          <span className={page.dim}>
            A task is running. The forecast of the next run starts from where the joint is after it.
          </span>
        </output>
      </Card>
    );
  }
  return (
    <Card title="Forecast">
      <output className={styles.prediction} aria-label="Prediction">
        {problem !== undefined && <Verdict good={false}>{problem}</Verdict>}
        {problem === undefined && prediction === undefined && <span className={page.dim}>Predicting …</span>}
        {problem === undefined && prediction !== undefined && (
          <>
            <div className={styles.forecast}>
              <ForecastMap prediction={prediction} />
              <dl className={page.facts}>
                <dt>
                  {labelWith("Joint", "rad", angles)}, now at {angleText(prediction.q_start, 1, angles)}
                </dt>
                <dd>
                  <strong>
                    {angleText(prediction.q_low, 1, angles)} to {angleText(prediction.q_high, 1, angles)}
                  </strong>
                </dd>
                <dt>Tendons</dt>
                <dd>
                  <strong>
                    {prediction.F_low === 0 ? "slack" : fixed(prediction.F_low, 1)} to{" "}
                    {fixed(prediction.F_high, 1)}
                  </strong>{" "}
                  N
                </dd>
                {prediction.figures.map((figure) => (
                  <Figure key={figure.name} {...figure} />
                ))}
                <dt>Until back in pretension</dt>
                <dd>{duration(prediction.duration_s)}</dd>
              </dl>
            </div>
            <Verdict good={prediction.enough_motion}>{inWords(prediction.message, angles)}</Verdict>
          </>
        )}
      </output>
    </Card>
  );
}

function Figure({ label, value, unit }: Prediction["figures"][number]) {
  const { unit: read, factor } = readingOf(unit, useAngles());
  const counts = unit === "encoder counts";
  return (
    <>
      <dt>{label}</dt>
      <dd>
        <strong>
          <Shown value={value} why="cannot be foreseen">
            {(some) => (counts ? fixed(some, 0) : significant(some * factor, 3))}
          </Shown>
        </strong>{" "}
        {read}
      </dd>
    </>
  );
}
