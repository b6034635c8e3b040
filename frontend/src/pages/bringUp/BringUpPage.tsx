import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { TbHandStop, TbPlugConnected } from "react-icons/tb";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/ControlMenu";
import { Refusal } from "../../components/Refusal";
import { capital, dateTime } from "../../samples/format";
import { fillText } from "../../samples/texts";
import { bringUpQuery, useStepCommand } from "../../service/api/system";
import { useMayCommand } from "../../service/control/control";
import type { BringUp } from "../../wire/types";
import pageStyles from "../Page.module.css";
import bringUpStyles from "./BringUp.module.css";
import { StepCard } from "./StepCard";
import { TEXTS } from "./texts";

interface DrivesProps {
  /** Whether the drives are on now. */
  readonly on: boolean;
  /** Whether the drive lockout is active; without it, Reset enables drives that a watchdog or a fault disabled. */
  readonly locked: boolean;
  /** Person who left the drives off before the service started, if nobody has switched them since. */
  readonly left: BringUp["drives_left"];
  /** Whether a step is running: it controls the drives. */
  readonly stepUnderWay: boolean;
}

/** Shows whether the drives are on, and their switch: a drive lockout lasts until a person ends it. */
export function Drives({ on, locked, left, stepUnderWay }: DrivesProps) {
  const command = useStepCommand();
  const switchOn = locked && !on;
  const Icon = on ? TbPlugConnected : TbHandStop;
  return (
    <section className={bringUpStyles.drives} aria-label={TEXTS.drives} data-on={on}>
      <Icon size={19} aria-hidden="true" />
      <p>
        <strong>{on ? TEXTS.drivesOn : TEXTS.drivesOff}</strong>{" "}
        {!on &&
          left !== null &&
          `${fillText(TEXTS.drivesLeft, { person: left.who, time: dateTime(left.at) })} `}
        {on ? TEXTS.whileOn : locked ? TEXTS.whileLocked : TEXTS.untilReset}
      </p>
      {!stepUnderWay && (
        <OperatorsOnly>
          <Button
            className={bringUpStyles.switch}
            size="sm"
            variant="default"
            loading={command.isPending}
            onClick={() => command.mutate({ do: "switch-drives", on: switchOn })}
          >
            {switchOn ? TEXTS.switchOn : TEXTS.switchOff}
          </Button>
        </OperatorsOnly>
      )}
      <Refusal error={command.error} about={[on, locked, stepUnderWay]} />
    </section>
  );
}

/** Page of the commissioning steps, from the wiring test with the drives off to the test of the safety module. */

export default function BringUpPage() {
  const { data, error } = useQuery(bringUpQuery);
  return (
    <div className={pageStyles.page}>
      <h1 className={pageStyles.title}>{TEXTS.title}</h1>
      {data?.applies ? (
        <Steps view={data} />
      ) : (
        <Nothing why={data?.why_not ?? error?.message ?? TEXTS.loading} />
      )}
    </div>
  );
}

function Nothing({ why }: { why: string }) {
  return (
    <Card title={TEXTS.steps}>
      <p className={pageStyles.empty}>{capital(why)}</p>
      <div className={bringUpStyles.none}>
        <p>{TEXTS.outline}</p>
        <ol>
          <li>{TEXTS.outlineSensors}</li>
          <li>{TEXTS.outlineForces}</li>
          <li>{TEXTS.outlineEncoders}</li>
          <li>{TEXTS.outlineMotors}</li>
          <li>{TEXTS.outlinePretension}</li>
        </ol>
        <p>
          <Link href="/docs/rig">{TEXTS.rigPage}</Link> {TEXTS.rigPageAfter}
        </p>
      </div>
    </Card>
  );
}

function Steps({ view }: { view: BringUp }) {
  const { steps, drives_on: on, drives_locked: locked, drives_left: left } = view;
  const viewer = useMayCommand() === false;
  const done = steps.filter(({ state }) => state === "current").length;
  const at = atStep(steps);
  const stepUnderWay = steps.some(({ running }) => running !== null);
  return (
    <>
      <p className={pageStyles.lead}>
        {done === steps.length
          ? fillText(TEXTS.allDone, { count: steps.length })
          : fillText(TEXTS.someDone, { done, count: steps.length })}{" "}
        {TEXTS.aboutSteps}
        {viewer && ` ${TEXTS.asViewer}`}
      </p>
      {on !== null && <Drives on={on} locked={locked} left={left} stepUnderWay={stepUnderWay} />}
      <ol className={bringUpStyles.steps} aria-label={TEXTS.stepList}>
        {steps.map((step, index) => (
          <li key={step.id}>
            <StepCard step={step} number={index + 1} open={index === at} />
          </li>
        ))}
      </ol>
    </>
  );
}

/** Returns the index of the running step, or of the first one that is not done; -1 for none. */
function atStep(steps: BringUp["steps"]): number {
  const running = steps.findIndex((step) => step.running !== null);
  return running >= 0 ? running : steps.findIndex(({ state }) => state !== "current");
}
