/** Card for contacts: estimated external force, calibration of its bias, and the contact reaction. */

import { Button } from "@mantine/core";
import { useEffect, useState } from "react";
import { Card } from "../../components/Card";
import { Refusal } from "../../components/Refusal";
import { ValueBox } from "../../components/ValueBox";
import { useLive, useLiveStore } from "../../live/react";
import { fixed } from "../../samples/format";
import { rangeOf } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { useConfigureContact } from "../../service/api/actuator";
import { useAngleUnit } from "../../service/api/preferences";
import { useWhyNoControl } from "../../service/control/control";
import { useDraft } from "../../service/forms/drafts";
import { RefusedFields } from "../../service/forms/refusals";
import { fieldEntry } from "../../service/glossary";
import type { State, TouchView } from "../../wire/types";
import styles from "./Operate.module.css";
import { TEXTS } from "./texts";

const POLL_MS = 100;
const USUAL_N = 2;

function isNumber(value: unknown): value is number {
  return typeof value === "number";
}

export function ContactCard() {
  const touch = useLive((live) => live.state?.touch);
  const limits = useLive((live) => live.state?.limits);
  return touch && limits ? <TouchControls touch={touch} limits={limits} /> : null;
}

function TouchControls({ touch, limits }: { touch: TouchView; limits: State["limits"] }) {
  const order = useConfigureContact();
  const noControl = useWhyNoControl();
  const angles = useAngleUnit();
  const running = useLive((live) => live.state?.mode === "run");
  const rejects = useLive((live) => (live.state?.tuning.k_ext ?? 0) > 0);
  const armed = touch.contact_N > 0;
  const sweeping = touch.sweep?.under_way ?? false;
  const chosen = useDraft("threshold of contacts", armed ? touch.contact_N : USUAL_N, isNumber);
  const [problem, setProblem] = useState<string | null>(null);
  const contact_N = chosen.value;
  const about = [contact_N, touch.learned.length];
  const refusal = problem === null ? order.error : null;
  const now = describeState(touch);
  return (
    <Card title={TEXTS.touch} aside={<ForceNow touch={touch} />}>
      <RefusedFields error={refusal} about={about}>
        {/* biome-ignore lint/a11y/useSemanticElements: the buttons act at once; they are not a form */}
        <div className={styles.touchRows} role="group" aria-label={TEXTS.touch}>
          <ValueBox
            isInForm
            label={TEXTS.threshold}
            unit="N"
            value={contact_N}
            decimals={1}
            step={0.5}
            width={86}
            messageId="refusal-of-touch"
            place="contact_N"
            entry={fieldEntry("touch.contact_N", angles, {
              minimum: limits.F_contact_min,
              maximum: limits.F_contact_max,
            })}
            onCommit={chosen.set}
            onProblem={setProblem}
          />
          <Button
            size="compact-sm"
            variant="default"
            disabled={noControl !== null || problem !== null || touch.learned.length === 0 || sweeping}
            onClick={() => order.mutate({ contact_N })}
          >
            {armed ? TEXTS.updateThreshold : TEXTS.enableReaction}
          </Button>
          <Button
            size="compact-sm"
            variant="default"
            disabled={noControl !== null || !armed}
            onClick={() => order.mutate({ contact_N: 0 })}
          >
            {TEXTS.disableReaction}
          </Button>
          <Button
            size="compact-sm"
            variant="default"
            disabled={noControl !== null || sweeping || !running}
            title={running ? TEXTS.calibrateHint : TEXTS.calibrateInRun}
            onClick={() => order.mutate({ learn: true })}
          >
            {TEXTS.calibrate}
          </Button>
          <Button
            size="compact-sm"
            variant="default"
            disabled={noControl !== null || armed || !(running || sweeping)}
            title={running || sweeping ? TEXTS.calibrateOverSHint : TEXTS.calibrateInRun}
            onClick={() => order.mutate({ sweep: sweeping ? "stop" : "begin" })}
          >
            {sweeping ? TEXTS.stopCalibration : TEXTS.calibrateOverS}
          </Button>
          <Button
            size="compact-sm"
            variant="default"
            disabled={noControl !== null || touch.learned.length === 0 || armed || sweeping || rejects}
            title={rejects ? TEXTS.biasInUse : undefined}
            onClick={() => order.mutate({ forget: true })}
          >
            {TEXTS.clearBias}
          </Button>
        </div>
        <output id="told-of-touch" className={styles.touchNow} data-matters={now !== null}>
          {now ?? describeCalibration(touch)}
        </output>
        <Refusal
          id="refusal-of-touch"
          error={refusal}
          about={about}
          forFields
          text={problem ?? noControl}
          hint={fillText(TEXTS.thresholdRange, {
            range: rangeOf(limits.F_contact_min, limits.F_contact_max),
          })}
        />
        <CalibrationTable points={touch.learned} />
      </RefusedFields>
    </Card>
  );
}

/** Bias and standard deviation of the external-force estimate at each calibrated stiffness. */
function CalibrationTable({ points }: { points: TouchView["learned"] }) {
  if (points.length === 0) return null;
  return (
    <table className={styles.learned} aria-label={TEXTS.calibration}>
      <thead>
        <tr>
          <th scope="col">S [N·m/rad]</th>
          <th scope="col">{TEXTS.biasHead}</th>
          <th scope="col">{TEXTS.deviationHead}</th>
        </tr>
      </thead>
      <tbody>
        {points.map(({ S, F, std_N }) => (
          <tr key={S}>
            <th scope="row">{fixed(S, 1)}</th>
            <td>{fixed(F, 2)}</td>
            <td>{fixed(std_N, 2)}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}

/** A component of its own, so that its changes, up to ten per second, do not render the boxes. */
function ForceNow({ touch }: { touch: TouchView }) {
  return <span className={styles.bounds}>{reading(useForce(), touch)}</span>;
}

/** Returns the contact, the enabled reaction, or the progress or early end of the calibration over S. */
function describeState({ felt, contact_N, sweep }: TouchView): string | null {
  if (felt) {
    return fillText(TEXTS.contact, { force: fixed(felt.F_ext_hat, 1) });
  }
  if (contact_N > 0) return fillText(TEXTS.reactionEnabled, { force: fixed(contact_N, 1) });
  if (!sweep?.under_way && !sweep?.why) return null;
  const at = { point: sweep.point, points: sweep.points, S: fixed(sweep.S_ref, 1) };
  if (sweep.under_way) return fillText(TEXTS.sweepRunning, at);
  return fillText(TEXTS.sweepEnded, { ...at, reason: sweep.why });
}

/** Returns the stiffnesses at which the bias of the external force is calibrated, as text. */
function describeCalibration({ learned: points }: TouchView): string {
  if (points.length === 0) return TEXTS.notCalibrated;
  return fillText(TEXTS.calibratedAt, { stiffnesses: points.map((point) => fixed(point.S, 1)).join(", ") });
}

/** Returns the external force as text, with the largest calibrated standard deviation, if any. */
function reading(force: number, { learned: points }: TouchView): string {
  if (!Number.isFinite(force)) return TEXTS.forceUnknown;
  const shown = fixed(force, 1);
  if (points.length === 0) return fillText(TEXTS.force, { force: shown });
  const spread = Math.max(...points.map((point) => point.std_N));
  return fillText(TEXTS.forceWithDeviation, { force: shown, deviation: fixed(spread, 2) });
}

/** Returns the external force [N], rounded to 0.1 N so that small changes do not render; NaN if unknown. */
function useForce(): number {
  const store = useLiveStore();
  const [force, setForce] = useState(Number.NaN);
  useEffect(() => {
    const timer = window.setInterval(
      () => setForce(Math.round(10 * store.window.newest("F_ext_hat")) / 10),
      POLL_MS,
    );
    return () => window.clearInterval(timer);
  }, [store]);
  return force;
}
