import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { TbHandStop, TbPlugConnected } from "react-icons/tb";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/ControlMenu";
import { Refusal } from "../../components/Refusal";
import { capital, dateTime } from "../../samples/format";
import { bringUpQuery, useStepCommand } from "../../service/api/system";
import { useMayCommand } from "../../service/control/control";
import type { BringUp } from "../../wire/types";
import pageStyles from "../Page.module.css";
import bringUpStyles from "./BringUp.module.css";
import { StepCard } from "./StepCard";

/** Whether the drives are on, and their switch: after hands were at the rig they stay off until somebody says otherwise. */

interface DrivesProps {
  /** How the line is at this moment. */
  readonly on: boolean;
  /** Whether the loop keeps them off; without it a reset brings back what a watchdog or a fault took away. */
  readonly locked: boolean;
  /** Who left them off before this service was started, where nobody has switched them since. */
  readonly left: BringUp["drives_left"];
  /** While a step is under way the drives are the step's. */
  readonly stepUnderWay: boolean;
}

export function Drives({ on, locked, left, stepUnderWay }: DrivesProps) {
  const command = useStepCommand();
  const switchOn = locked && !on;
  const Icon = on ? TbPlugConnected : TbHandStop;
  return (
    <section className={bringUpStyles.drives} aria-label="Drives" data-on={on}>
      <Icon size={19} aria-hidden="true" />
      <p>
        <strong>{on ? "Drives on." : "Drives off."}</strong>{" "}
        {!on &&
          left !== null &&
          `${left.who} left them so on ${dateTime(left.at)}, and the service was started since: hands may still be at the rig. `}
        {on ? ON : locked ? LOCKED : UNTIL_RESET}
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
            {switchOn ? "Switch drives on" : "Switch drives off"}
          </Button>
        </OperatorsOnly>
      )}
      <Refusal error={command.error} about={[on, locked, stepUnderWay]} />
    </section>
  );
}

const ON = "Keep your hands off the rig, or switch them off before you reach in.";
const LOCKED =
  "The motors can be turned by hand, and nothing starts. Take your hands off before they come on.";
const UNTIL_RESET = "They come back with the reset. After it, switch them off before you reach in.";

/** Bringing a rig up, step by step: from drives off and a turn by hand to a safety module that was seen to trip. */

export default function BringUpPage() {
  const { data, error } = useQuery(bringUpQuery);
  return (
    <div className={pageStyles.page}>
      <h1 className={pageStyles.title}>Bring-up</h1>
      {data?.applies ? (
        <Steps view={data} />
      ) : (
        <Nothing why={data?.why_not ?? error?.message ?? "Loading …"} />
      )}
    </div>
  );
}

function Nothing({ why }: { why: string }) {
  return (
    <Card title="Steps">
      <p className={pageStyles.empty}>{capital(why)}</p>
      <div className={bringUpStyles.none}>
        <p>On a rig this pageStyles leads from drives off to a joint that may be driven:</p>
        <ol>
          <li>with drives off each sensor is turned or pulled by hand, and has to read what it should;</li>
          <li>the load cells are tared, and calibrated with known weights;</li>
          <li>the encoders count from where the joint is known to be, by hand or by its end switch;</li>
          <li>each motor is driven a little, and has to go to its side;</li>
          <li>the tendons are wound to the pretension, and the safety module is seen to cut the motors.</li>
        </ol>
        <p>
          <Link href="/docs/rig">The rig</Link> says what each step proves. The same steps can be tried
          without hardware on the virtual card.
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
        {done === steps.length ? "All" : done} of {steps.length} steps are done. Each is small, can be
        cancelled, and is kept with who did it and when.
        {viewer && " You are signed in as a viewer: you look on, and may press STOP."}
      </p>
      {on !== null && <Drives on={on} locked={locked} left={left} stepUnderWay={stepUnderWay} />}
      <ol className={bringUpStyles.steps} aria-label="Steps of the bring-up">
        {steps.map((step, index) => (
          <li key={step.id}>
            <StepCard step={step} number={index + 1} open={index === at} />
          </li>
        ))}
      </ol>
    </>
  );
}

/** The step to look at: the one that runs, or else the first that is not done; -1 for none. */
function atStep(steps: BringUp["steps"]): number {
  const running = steps.findIndex((step) => step.running !== null);
  return running >= 0 ? running : steps.findIndex(({ state }) => state !== "current");
}
