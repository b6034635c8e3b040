/** One step of the bring-up: how it stands, what to do, its start, what is asked while it runs, what came of it. */

import { Button, Loader } from "@mantine/core";
import type { FormEvent } from "react";
import type { IconType } from "react-icons";
import { TbAlertTriangle, TbCircle, TbCircleCheck, TbCircleX, TbPlayerPlay } from "react-icons/tb";
import { Shown } from "../../components/Absent";
import { Card } from "../../components/Card";
import { Explained } from "../../components/Explained";
import { LocalizedText } from "../../components/LocalizedText";
import { NumberField } from "../../components/NumberField";
import { OperatorsOnly } from "../../components/OperatorsOnly";
import { Refusal } from "../../components/Refusal";
import { Verdict } from "../../components/Verdict";
import { useLive } from "../../live/react";
import { dateTime, duration, NOT_MEASURED, significant } from "../../samples/format";
import { type Angles, labelWith, offered, rangeText, readingOf, withUnit } from "../../samples/quantity";
import { capital } from "../../samples/words";
import { useAngles } from "../../service/angles";
import { useStepCommand } from "../../service/bringUp";
import { RefusedFields } from "../../service/refusedFields";
import { isPlainRecord, useDraft } from "../../service/useDraft";
import type { BringUpResult, BringUpRunning, BringUpStep } from "../../wire/types";
import page from "../Page.module.css";
import styles from "./BringUp.module.css";
import { StepReadings } from "./StepReadings";

type Standing = BringUpStep["state"] | "running";

const STANDING: Record<Standing, { word: string; Icon: IconType }> = {
  never: { word: "to do", Icon: TbCircle },
  current: { word: "done", Icon: TbCircleCheck },
  out_of_date: { word: "out of date", Icon: TbAlertTriangle },
  failed: { word: "failed", Icon: TbCircleX },
  running: { word: "under way", Icon: TbPlayerPlay },
};

/** What was typed into the boxes of a step, by name; text where it is no number. */
type Typed = Readonly<Record<string, number | string>>;

interface StepCardProps {
  readonly step: BringUpStep;
  readonly number: number;
  /** Whether it is the one to look at now: it runs, or it is the next to do. */
  readonly open: boolean;
}

const NOTHING: Typed = {};

function isTyped(value: unknown): value is Typed {
  return isPlainRecord(value) && !Object.values(value).some((one) => typeof one === "boolean");
}

export function StepCard({ step, number, open }: StepCardProps) {
  const { id, title, instruction, state, why, result, running } = step;
  // outlives the run of the step: whoever does it again finds the numbers that they typed
  const { value: changed, set: setChanged } = useDraft<Typed>(
    `numbers of bring-up step ${id}`,
    NOTHING,
    isTyped,
  );
  const standing: Standing = running === null ? state : "running";
  const { word, Icon } = STANDING[standing];
  return (
    <Card
      title={`${number}. ${title}`}
      className={styles.step}
      aside={
        <span className={styles.standing} data-standing={standing}>
          <Icon size={17} aria-hidden="true" />
          <Explained of={`step:${state}`} quiet>
            {word}
          </Explained>
        </span>
      }
    >
      <div className={styles.halves} data-open={open}>
        <div className={page.fields}>
          <p className={styles.text}>
            <LocalizedText text={instruction} />
          </p>
          {why !== "" && state !== "never" && (
            <p className={styles.why} data-standing={standing}>
              <LocalizedText text={capital(why)} />
            </p>
          )}
          {running === null ? (
            <Start step={step} prominent={open} changed={changed} onChange={setChanged} />
          ) : (
            <UnderWay running={running} title={title} />
          )}
        </div>
        <div className={styles.seen}>
          {open && <StepReadings step={id} />}
          {result !== null && <Result result={result} outdated={state === "out_of_date"} />}
        </div>
      </div>
    </Card>
  );
}

interface StartProps {
  readonly step: BringUpStep;
  readonly prominent: boolean;
  readonly changed: Typed;
  onChange(changed: Typed): void;
}

function Start({ step, prominent, changed, onChange }: StartProps) {
  const { id, title, inputs, blocked, state } = step;
  const word = state === "current" ? "Repeat" : "Start";
  const angles = useAngles();
  const command = useStepCommand();
  const values = Object.fromEntries(
    inputs.map((input) => [input.name, changed[input.name] ?? offered(input.default, input, angles)]),
  );
  const numbers = numbersIn(values);
  const reason = blocked !== "" ? capital(blocked) : numbers === null ? "A value is no number." : null;

  function submit(event: FormEvent): void {
    event.preventDefault();
    if (reason === null && numbers !== null) command.mutate({ do: "start", step: id, values: numbers });
  }

  return (
    <RefusedFields error={command.error} about={changed}>
      <form className={page.fields} aria-label={title} onSubmit={submit}>
        {inputs.length > 0 && (
          <div className={styles.inputs}>
            {inputs.map(({ name, words, unit, minimum, maximum }) => (
              <NumberField
                key={name}
                name={name}
                label={labelWith(capital(words), unit, angles)}
                unit={unit}
                description={rangeText(minimum, maximum, unit, angles)}
                value={values[name] ?? ""}
                onChange={(value) => onChange({ ...changed, [name]: value })}
              />
            ))}
          </div>
        )}
        <OperatorsOnly>
          <div className={page.actions}>
            <Button
              type="submit"
              size="sm"
              variant={prominent ? "filled" : "default"}
              aria-label={`${word} ${title.toLowerCase()}`}
              aria-disabled={reason !== null}
              data-disabled={reason !== null || undefined}
              loading={command.isPending}
            >
              {word}
            </Button>
          </div>
        </OperatorsOnly>
        <Refusal error={command.error} about={[changed, blocked]} text={reason} />
      </form>
    </RefusedFields>
  );
}

/** The values as numbers; null where one of them is none. */
function numbersIn(values: Record<string, number | string>): Record<string, number> | null {
  const all = Object.entries(values);
  return all.every((entry): entry is [string, number] => typeof entry[1] === "number")
    ? Object.fromEntries(all as [string, number][])
    : null;
}

/** Nothing in it moves when something is asked: whoever goes for Cancel must not meet Confirm there. */
function UnderWay({ running, title }: { running: BringUpRunning; title: string }) {
  const { phase, elapsed_s, confirm } = running;
  const command = useStepCommand();
  const asked = confirm !== "";
  const virtual = useLive((live) => live.state?.plant.kind === "virtual_card");
  return (
    // biome-ignore lint/a11y/useSemanticElements: buttons that act at once are no form
    <div className={styles.running} role="group" aria-label={`${title} under way`}>
      <div className={styles.phase}>
        {!asked && <Loader size={14} aria-hidden="true" />}
        <output aria-label="Progress">
          <LocalizedText text={capital(phase)} />
        </output>
        <span className={page.dim}>{duration(elapsed_s)}</span>
      </div>
      <output aria-label="What to do now" className={styles.asked} data-asked={asked}>
        {asked && <LocalizedText text={confirm} />}
        {asked && virtual && <span className={page.dim}> On this virtual card, Confirm does it.</span>}
      </output>
      <OperatorsOnly>
        <div className={page.actions}>
          <Button
            size="sm"
            aria-disabled={!asked}
            data-disabled={!asked || undefined}
            loading={command.isPending && command.variables.do === "confirm"}
            onClick={() => asked && command.mutate({ do: "confirm" })}
          >
            Confirm
          </Button>
          <Button
            size="sm"
            variant="default"
            loading={command.isPending && command.variables.do === "cancel"}
            onClick={() => command.mutate({ do: "cancel" })}
          >
            Cancel
          </Button>
        </div>
      </OperatorsOnly>
      <Refusal error={command.error} about={[phase, confirm]} />
    </div>
  );
}

function Result({ result, outdated }: { result: BringUpResult; outdated: boolean }) {
  const angles = useAngles();
  const { passed, text, figures, who, at } = result;
  return (
    <section className={styles.result} aria-label="Result" data-outdated={outdated}>
      <Verdict good={passed}>{capital(text)}</Verdict>
      {figures.length > 0 && (
        <dl className={page.facts}>
          {figures.map(({ words, value, unit }) => (
            <div key={words} className={styles.figure}>
              <dt>{words}</dt>
              <dd>
                <Shown value={value} why={NOT_MEASURED}>
                  {(number) => figure(number, unit, angles)}
                </Shown>
              </dd>
            </div>
          ))}
        </dl>
      )}
      <span className={page.dim}>
        {who}, {dateTime(at)}
      </span>
    </section>
  );
}

const DIGITS = 4;

function figure(value: number, unit: string, angles: Angles): string {
  const { unit: read, factor } = readingOf(unit, angles);
  const number = significant(value * factor, DIGITS);
  return withUnit(number, read);
}
