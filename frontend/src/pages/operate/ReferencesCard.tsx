/** What the cascade is asked to follow. */

import { Slider } from "@mantine/core";
import { useState } from "react";
import { Card } from "../../components/Card";
import { Refusal } from "../../components/Refusal";
import { SignalName } from "../../components/SignalName";
import { TargetKeys } from "../../components/TargetKeys";
import { TouchLock } from "../../components/TouchLock";
import { ValueBox } from "../../components/ValueBox";
import { useLive } from "../../live/react";
import { fixed } from "../../samples/format";
import { FINER, rangeOf, readingOf, toSI, withUnit } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { fieldEntry } from "../../service/fieldHelp";
import type { Entry } from "../../service/glossary";
import { useErrorLifetime } from "../../service/useErrorLifetime";
import { useNoControl, useNoRetuning } from "../../service/useNoControl";
import { useReferenceOrders } from "../../service/useReferenceOrders";
import { useSentValue } from "../../service/useSentValue";
import type { Limits, State } from "../../wire/types";
import { whyNoReferences } from "./allowed";
import { MotionControl } from "./MotionControl";
import styles from "./Operate.module.css";

export function ReferencesCard() {
  const references = useLive((live) => live.state?.references);
  const limits = useLive((live) => live.state?.limits);
  const open = useLive((live) => live.state?.mode === "compliance");
  const noControl = useNoControl();
  const locked = useLive((live) => whyNoReferences(live.state, noControl));
  const tuning = useLive((live) => live.state?.tuning);
  const fixedTuning = useNoRetuning();
  return (
    <Card title="References">
      {references && limits ? (
        <ReferenceControls references={references} limits={limits} open={open} locked={locked} />
      ) : (
        <div className={styles.reserve} />
      )}
      {tuning && <MotionControl tuning={tuning} disabled={fixedTuning !== null} />}
    </Card>
  );
}

interface ControlsProps {
  readonly references: State["references"];
  readonly limits: Limits;
  /** Whether the joint loop is open. */
  readonly open: boolean;
  /** Why they cannot be set now; null where they can. */
  readonly locked: string | null;
}

function ReferenceControls({ references, limits, open, locked }: ControlsProps) {
  const { mutateAsync: send } = useReferenceOrders();
  const angles = useAngles();
  const { unit, factor } = readingOf("rad", angles);
  const { q_ref, S_ref, in_force } = references;
  const measured = in_force ? null : "measured, no reference";
  const remark = (more: string | null) => measured ?? locked ?? more;
  const slack = S_ref === null ? "slack: no stiffness" : null;
  return (
    <>
      <ReferenceControl
        name="q_ref"
        key={unit}
        unit={unit}
        inForce={q_ref * factor}
        entry={fieldEntry("references.q_ref", angles, { minimum: limits.q_min, maximum: limits.q_max })}
        min={limits.q_min * factor}
        max={limits.q_max * factor}
        step={angles === "deg" ? 1 : 0.02}
        decimals={angles === "deg" ? 1 : 1 + FINER}
        remark={remark(open ? "joint loop open, by geometry" : null)}
        disabled={locked !== null}
        send={(value) => send({ q_ref: toSI(value, "rad", angles) })}
      />
      <ReferenceControl
        name="S_ref"
        unit="N·m/rad"
        inForce={S_ref ?? Number.NaN}
        entry={fieldEntry("references.S_ref", angles, { minimum: limits.S_min, maximum: limits.S_max })}
        min={limits.S_min}
        max={limits.S_max}
        step={0.1}
        decimals={2}
        remark={slack ?? remark(null)}
        disabled={locked !== null}
        send={(value) => send({ S_ref: value })}
      />
    </>
  );
}

interface ReferenceControlProps {
  readonly name: string;
  readonly unit: string;
  /** What it is for, and what is accepted. */
  readonly entry: Entry | undefined;
  /** NaN where nothing is known, as the stiffness of slack tendons. */
  readonly inForce: number;
  readonly min: number;
  readonly max: number;
  readonly step: number;
  readonly decimals: number;
  /** What the value means now, beside its range. */
  readonly remark: string | null;
  readonly disabled: boolean;
  send(value: number): Promise<unknown>;
}

function ReferenceControl(props: ReferenceControlProps) {
  const { name, unit, entry, inForce, min, max, step, decimals, remark, disabled, send } = props;
  const sent = useSentValue(inForce, send);
  const [problem, setProblem] = useState<string | null>(null);
  const [proposed, setProposed] = useState(false);
  const target = proposed
    ? `${withUnit(fixed(sent.value, decimals), unit)} is not sent yet: Enter commands it, Escape leaves it.`
    : null;
  const refusal = problem === null && target === null ? sent.refusal : null;
  const refused = useErrorLifetime(refusal, inForce) !== null;
  return (
    <div className={styles.control}>
      <div className={styles.referenceRow}>
        <span className={styles.name}>
          <SignalName name={name} />
        </span>
        <TouchLock name={name}>
          <TargetKeys
            min={min}
            max={max}
            step={step}
            value={sent.value}
            proposed={proposed}
            onPropose={(value) => {
              setProposed(true);
              sent.edit(value);
            }}
            onCommand={() => {
              setProposed(false);
              sent.commit(sent.value);
            }}
            onLeave={() => {
              setProposed(false);
              sent.cancel();
            }}
          >
            <Slider
              thumbLabel={name}
              // the value itself: what is only measured may lie beside the scale, where the thumb ends
              thumbValueText={
                Number.isFinite(sent.value)
                  ? `${withUnit(fixed(sent.value, decimals), unit)}${proposed ? ", not sent yet" : ""}`
                  : "slack"
              }
              size="sm"
              disabled={disabled}
              min={min}
              max={max}
              step={step}
              value={Number.isFinite(sent.value) ? sent.value : min}
              label={null}
              startPointValue={Math.max(0, min)}
              onChange={sent.edit}
              onChangeEnd={(value) => {
                setProposed(false);
                sent.commit(value);
              }}
            />
          </TargetKeys>
        </TouchLock>
        <ValueBox
          label={`${name} value [${unit}]`}
          unit={unit}
          value={sent.value}
          decimals={decimals}
          step={step}
          width={124}
          disabled={disabled}
          onCommit={sent.commit}
          onProblem={setProblem}
          saidAt={`refusal-of-${name}`}
          entry={entry}
          refused={refused}
        />
      </div>
      <Refusal
        id={`refusal-of-${name}`}
        error={refusal}
        about={inForce}
        text={problem ?? target}
        hint={`${withUnit(rangeOf(min, max), unit)}${remark === null ? "" : `; ${remark}`}`}
      />
    </div>
  );
}
