/** Card of the trigger capture: condition on a signal, and the time range of the flight record. */

import { Button } from "@mantine/core";
import { useQueryClient } from "@tanstack/react-query";
import { type FormEvent, useEffect } from "react";
import { Link } from "wouter";
import { signalChoices } from "../../charts/SignalTree";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/ControlMenu";
import { ChoiceField, NumberField } from "../../components/fields";
import { Refusal } from "../../components/Refusal";
import { useLive } from "../../live/react";
import { localizeText, readingOf } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { useDerived } from "../../service/api/formulas";
import { useAngleUnit } from "../../service/api/preferences";
import {
  CONDITIONS,
  describeTrigger,
  flightsQuery,
  isWindow,
  useArmTrigger,
  useDisarmTrigger,
} from "../../service/api/recordings";
import { isNumberOrText, isPlainRecord, isText, useDraft } from "../../service/forms/drafts";
import { RefusedFields } from "../../service/forms/refusals";
import { fieldEntry } from "../../service/glossary";
import { unitOf } from "../../theme/signals";
import type { TriggerOrder } from "../../wire/types";
import styles from "./Trigger.module.css";
import { TEXTS } from "./texts";

type Typed = number | string;

/** Values of the form. */
interface Condition {
  readonly signal: string;
  readonly condition: TriggerOrder["condition"];
  readonly level: Typed;
  readonly upper: Typed;
  readonly before_s: Typed;
  readonly after_s: Typed;
  readonly captures: Typed;
}

const USUAL: Condition = {
  signal: "F_A",
  condition: "rising",
  level: 20,
  upper: 30,
  before_s: 1,
  after_s: 1,
  captures: 1,
};

function isCondition(value: unknown): value is Condition {
  if (!isPlainRecord(value)) return false;
  const { signal, condition, level, upper, before_s, after_s, captures } = value;
  const known = isText(signal) && CONDITIONS.some((one) => one.value === condition);
  return known && [level, upper, before_s, after_s, captures].every(isNumberOrText);
}

export function TriggerCard() {
  const trigger = useLive((live) => live.state?.trigger ?? null);
  const angles = useAngleUnit();
  const queries = useQueryClient();
  const captured = trigger?.captured ?? 0;
  // biome-ignore lint/correctness/useExhaustiveDependencies: each capture adds a record to the list
  useEffect(() => void queries.invalidateQueries({ queryKey: flightsQuery.queryKey }), [captured, queries]);
  const waits = trigger !== null && trigger.phase !== "ended";
  const stateText = localizeText(describeTrigger(trigger), angles);
  return (
    <Card
      title={TEXTS.trigger}
      aside={<Link href="/system">{captured > 0 ? TEXTS.captures : TEXTS.flights}</Link>}
    >
      <output className={styles.state} aria-label={TEXTS.triggerState} data-phase={trigger?.phase ?? "none"}>
        {waits ? fillText(TEXTS.armedBy, { state: stateText, person: trigger.who }) : stateText}
      </output>
      <OperatorsOnly>{waits ? <Disarm /> : <ArmForm />}</OperatorsOnly>
    </Card>
  );
}

function Disarm() {
  const disarm = useDisarmTrigger();
  return (
    <div className={styles.row}>
      <Button size="compact-sm" variant="default" loading={disarm.isPending} onClick={() => disarm.mutate()}>
        {TEXTS.disarm}
      </Button>
      <Refusal error={disarm.error} hint={TEXTS.disarmHint} />
    </div>
  );
}

function ArmForm() {
  const arm = useArmTrigger();
  const angles = useAngleUnit();
  const derived = useDerived();
  const draft = useDraft<Condition>("trigger", USUAL, isCondition);
  const { signal, condition, level, upper, before_s, after_s, captures } = draft.value;
  const set = (part: Partial<Condition>) => draft.set((before) => ({ ...before, ...part }));
  const window = isWindow(condition);
  const unit = unitOf(signal);
  const read = unit === "1" ? "" : ` [${readingOf(unit, angles).unit}]`;
  const numbers = [level, ...(window ? [upper] : []), before_s, after_s, captures];
  const ready = numbers.every((one) => typeof one === "number");
  const about = [signal, condition, ...numbers];

  function submit(event: FormEvent): void {
    event.preventDefault();
    if (!ready) return;
    arm.mutate({
      signal,
      condition,
      level: Number(level),
      upper: window ? Number(upper) : null,
      before_s: Number(before_s),
      after_s: Number(after_s),
      captures: Number(captures),
    });
  }

  const box = { size: "xs", messageId: "refusal-of-trigger" } as const;
  return (
    <RefusedFields error={arm.error} about={about}>
      <form aria-label={TEXTS.triggerForm} onSubmit={submit}>
        <div className={styles.row}>
          <ChoiceField
            {...box}
            name="signal"
            label={TEXTS.signal}
            value={signal}
            data={signalChoices(null, derived).map(({ group, items }) => ({
              group,
              items: items.map(({ value }) => ({ value, label: value })),
            }))}
            entry={fieldEntry("trigger.signal", angles)}
            onChange={(value) => set({ signal: value })}
          />
          <ChoiceField
            {...box}
            name="condition"
            label={TEXTS.condition}
            value={condition}
            data={CONDITIONS}
            entry={fieldEntry("trigger.condition", angles)}
            onChange={(value) => set({ condition: value as TriggerOrder["condition"] })}
          />
          <NumberField
            {...box}
            name="level"
            label={fillText(window ? TEXTS.from : TEXTS.level, { unit: read })}
            w={84}
            unit={unit}
            value={level}
            entry={fieldEntry("trigger.level", angles)}
            onChange={(value) => set({ level: value })}
          />
          {window && (
            <NumberField
              {...box}
              name="upper"
              label={fillText(TEXTS.to, { unit: read })}
              w={84}
              unit={unit}
              value={upper}
              entry={fieldEntry("trigger.upper", angles)}
              onChange={(value) => set({ upper: value })}
            />
          )}
          <NumberField
            {...box}
            name="before_s"
            label={TEXTS.before}
            w={76}
            unit="s"
            value={before_s}
            entry={fieldEntry("trigger.before_s", angles)}
            onChange={(value) => set({ before_s: value })}
          />
          <NumberField
            {...box}
            name="after_s"
            label={TEXTS.after}
            w={76}
            unit="s"
            value={after_s}
            entry={fieldEntry("trigger.after_s", angles)}
            onChange={(value) => set({ after_s: value })}
          />
          <NumberField
            {...box}
            name="captures"
            label={TEXTS.captureCount}
            w={76}
            value={captures}
            entry={fieldEntry("trigger.captures", angles)}
            onChange={(value) => set({ captures: value })}
          />
          <Button
            type="submit"
            size="compact-sm"
            className={styles.arm ?? ""}
            disabled={!ready}
            loading={arm.isPending}
          >
            {TEXTS.arm}
          </Button>
        </div>
        <Refusal
          id="refusal-of-trigger"
          error={arm.error}
          about={about}
          forFields
          text={ready ? null : TEXTS.numbersMissing}
          hint={TEXTS.armHint}
        />
      </form>
    </RefusedFields>
  );
}
