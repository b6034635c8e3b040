import { SegmentedControl, Slider } from "@mantine/core";
import { useState } from "react";
import { Card } from "../../components/Card";
import { Explained } from "../../components/Explained";
import { Refusal } from "../../components/Refusal";
import { TargetKeys, TouchLock } from "../../components/sliders";
import { ValueBox } from "../../components/ValueBox";
import { SignalName } from "../../components/values";
import { useLive } from "../../live/react";
import { fixed } from "../../samples/format";
import { FINER, rangeOf, readingOf, toSI, withUnit } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { useReferenceOrders } from "../../service/api/actuator";
import { useAngleUnit } from "../../service/api/preferences";
import { ON_TRIAL, useSetTuning } from "../../service/api/tuning";
import { useWhyNoControl, useWhyNoRetuning } from "../../service/control/control";
import { useSentValue } from "../../service/forms/drafts";
import { useErrorLifetime } from "../../service/forms/refusals";
import { type Entry, fieldEntry } from "../../service/glossary";
import type { Limits, Mode, State, Tuning } from "../../wire/types";
import { whyNot } from "./ModeCard";
import operateStyles from "./Operate.module.css";
import { TEXTS } from "./texts";

/** Control of the motion: the paper's law (lambda) or a voltage-limited trajectory (time-optimal). */

const STEP_V = 0.1;
const DECIMALS = 1;
const MOTIONS = ["lambda", "time-optimal"] as const;

interface MotionControlProps {
  readonly tuning: Tuning;
  /** No change of the tuning is accepted now. */
  readonly disabled: boolean;
}

export function MotionControl({ tuning, disabled }: MotionControlProps) {
  const choose = useSetTuning();
  const { mutateAsync: setTuning } = useSetTuning();
  const motion = (choose.isPending && choose.variables.motion) || tuning.motion;
  const limit = useSentValue(tuning.u_plan, (u_plan) => setTuning({ motion: "time-optimal", u_plan }));
  const [problem, setProblem] = useState<string | null>(null);
  const refusal = problem === null ? (choose.error ?? limit.refusal) : null;
  const refused = useErrorLifetime(limit.refusal, tuning.u_plan) !== null;
  const angles = useAngleUnit();
  const { u_plan_min, u_plan_max } = tuning;
  return (
    <div className={operateStyles.control}>
      <div className={operateStyles.row}>
        <Explained of="setting:tuning.motion">{TEXTS.motion}</Explained>
        <SegmentedControl
          className={operateStyles.motions}
          size="xs"
          aria-label={TEXTS.motion}
          data={[...MOTIONS]}
          value={motion}
          disabled={disabled}
          onChange={(value) => {
            const chosen = MOTIONS.find((one) => one === value);
            if (chosen !== undefined) choose.mutate({ motion: chosen });
          }}
        />
      </div>
      {motion === "time-optimal" && (
        <div className={operateStyles.limitRow}>
          <Explained of="setting:tuning.u_plan">{TEXTS.voltageLimit}</Explained>
          <ValueBox
            label={TEXTS.voltageLimitBox}
            unit="V"
            value={limit.value}
            decimals={DECIMALS}
            step={STEP_V}
            width={124}
            disabled={disabled}
            onCommit={limit.commit}
            onProblem={setProblem}
            messageId="refusal-of-u_plan"
            entry={fieldEntry("tuning.u_plan", angles, { minimum: u_plan_min, maximum: u_plan_max })}
            refused={refused}
          />
        </div>
      )}
      <Refusal
        id="refusal-of-u_plan"
        error={refusal}
        about={`${tuning.motion} ${tuning.u_plan}`}
        text={problem}
        hint={
          motion === "lambda"
            ? TEXTS.effectOfLambda
            : fillText(TEXTS.effectOfTimeOptimal, {
                range: `${fixed(u_plan_min, DECIMALS)} to ${fixed(u_plan_max, DECIMALS)}`,
              })
        }
      />
    </div>
  );
}

/** Reasons why the service would refuse a command now; the page then disables its control. Pure. */

/** Returns why no experiment or identification can start, or null. `noControl` names the holder of control. */
export function whyNoStart(state: State | null, mode: Mode, noControl: string | null): string | null {
  if (noControl !== null) return noControl;
  if (state?.task != null) return TEXTS.anotherRun;
  if (state?.trial != null) return ON_TRIAL;
  return whyNot(state, mode);
}

/** Returns the reason why references cannot be set; null if they can. */
export function whyNoReferences(state: State | null, noControl: string | null): string | null {
  if (state === null) return TEXTS.referencesUnknown;
  if (state.player) return TEXTS.referencesInReplay;
  if (noControl !== null) return noControl;
  if (state.mode !== "run" && state.mode !== "compliance") return TEXTS.referencesNeedMode;
  return state.touch.felt === null ? null : TEXTS.referencesInContact;
}

/** Card with the references q_ref and S_ref, and the motion. */

export function ReferencesCard() {
  const references = useLive((live) => live.state?.references);
  const limits = useLive((live) => live.state?.limits);
  const open = useLive((live) => live.state?.mode === "compliance");
  const noControl = useWhyNoControl();
  const locked = useLive((live) => whyNoReferences(live.state, noControl));
  const tuning = useLive((live) => live.state?.tuning);
  const fixedTuning = useWhyNoRetuning();
  return (
    <Card title={TEXTS.references}>
      {references && limits ? (
        <ReferenceControls references={references} limits={limits} open={open} locked={locked} />
      ) : (
        <div className={operateStyles.reserve} />
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
  /** Reason why the references cannot be set now; null if they can. */
  readonly locked: string | null;
}

function ReferenceControls({ references, limits, open, locked }: ControlsProps) {
  const { mutateAsync: send } = useReferenceOrders();
  const angles = useAngleUnit();
  const { unit, factor } = readingOf("rad", angles);
  const { q_ref, S_ref, in_force } = references;
  const measured = in_force ? null : TEXTS.measuredOnly;
  const remark = (more: string | null) => measured ?? locked ?? more;
  const slack = S_ref === null ? TEXTS.noStiffnessSlack : null;
  return (
    <>
      <ReferenceControl
        name="q_ref"
        key={unit}
        unit={unit}
        active={q_ref * factor}
        entry={fieldEntry("references.q_ref", angles, { minimum: limits.q_min, maximum: limits.q_max })}
        min={limits.q_min * factor}
        max={limits.q_max * factor}
        step={angles === "deg" ? 1 : 0.02}
        decimals={angles === "deg" ? 1 : 1 + FINER}
        remark={remark(open ? TEXTS.jointLoopOpen : null)}
        disabled={locked !== null}
        send={(value) => send({ q_ref: toSI(value, "rad", angles) })}
      />
      <ReferenceControl
        name="S_ref"
        unit="N·m/rad"
        active={S_ref ?? Number.NaN}
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
  /** Explanation and accepted range. */
  readonly entry: Entry | undefined;
  /** Active or measured value; NaN if unknown, such as the stiffness with slack tendons. */
  readonly active: number;
  readonly min: number;
  readonly max: number;
  readonly step: number;
  readonly decimals: number;
  /** Note after the range: the current meaning of the value, or why it cannot be set. */
  readonly remark: string | null;
  readonly disabled: boolean;
  send(value: number): Promise<unknown>;
}

function ReferenceControl(props: ReferenceControlProps) {
  const { name, unit, entry, active, min, max, step, decimals, remark, disabled, send } = props;
  const sent = useSentValue(active, send);
  const [problem, setProblem] = useState<string | null>(null);
  const [proposed, setProposed] = useState(false);
  const shown = Number.isFinite(sent.value) ? withUnit(fixed(sent.value, decimals), unit) : TEXTS.slack;
  const target = proposed
    ? fillText(TEXTS.referenceNotSent, { value: withUnit(fixed(sent.value, decimals), unit) })
    : null;
  const range = withUnit(rangeOf(min, max), unit);
  const refusal = problem === null && target === null ? sent.refusal : null;
  const refused = useErrorLifetime(refusal, active) !== null;
  return (
    <div className={operateStyles.control}>
      <div className={operateStyles.referenceRow}>
        <span className={operateStyles.name}>
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
              // a measured value may be outside the scale; the thumb then stops at its end
              thumbValueText={
                proposed && Number.isFinite(sent.value)
                  ? fillText(TEXTS.sliderNotSent, { value: shown })
                  : shown
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
          label={fillText(TEXTS.referenceBox, { name, unit })}
          unit={unit}
          value={sent.value}
          decimals={decimals}
          step={step}
          width={124}
          disabled={disabled}
          onCommit={sent.commit}
          onProblem={setProblem}
          messageId={`refusal-of-${name}`}
          entry={entry}
          refused={refused}
        />
      </div>
      <Refusal
        id={`refusal-of-${name}`}
        error={refusal}
        about={active}
        text={problem ?? target}
        hint={remark === null ? range : fillText(TEXTS.rangeAndRemark, { range, remark })}
      />
    </div>
  );
}
