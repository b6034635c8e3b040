/** Results of both motors: least squares, the 63.21 % rule and the values used during the run, and the steps. */

import { Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import type { ReactNode } from "react";
import { type Curve, CurvePlot } from "../../charts/CurvePlot";
import { Verdict } from "../../components/RunState";
import { Absent, SignalName } from "../../components/values";
import { capital, fixed, significant } from "../../samples/format";
import { readingOf, withUnit } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { curvesQuery } from "../../service/api/identifications";
import { useAngleUnit } from "../../service/api/preferences";
import { HUES } from "../../theme/signals";
import type { Identification, Motor, MotorCurves } from "../../wire/types";
import page from "../Page.module.css";
import styles from "./Identify.module.css";
import { TEXTS } from "./texts";

const SIDE_HUES = { A: HUES.u_A, B: HUES.u_B };

export function MotorResult({ identification }: { identification: Identification }) {
  const curves = useQuery(curvesQuery(identification.run));
  return (
    <div className={page.halves}>
      {identification.motors.map((motor) => (
        <section
          key={motor.side}
          className={styles.model}
          aria-label={fillText(TEXTS.motor, { side: motor.side })}
        >
          <h3 className={styles.heading}>{fillText(TEXTS.motor, { side: motor.side })}</h3>
          <Estimates motor={motor} />
          <Verdict good={motor.grade === "usable"} of={`grade:${motor.grade}`}>
            {capital(motor.grade)}
          </Verdict>
          {motor.refused.map((reason) => (
            <Verdict key={reason} good={false}>
              {reason}
            </Verdict>
          ))}
          <Steps curves={curves.data?.motors.find((drawn) => drawn.side === motor.side)} />
        </section>
      ))}
    </div>
  );
}

function Estimates({ motor }: { motor: Motor }) {
  const { fitted, std_errors, rule_mean, rule_spread, before } = motor;
  const change = (now: number, then: number) =>
    `${now > then ? "+" : ""}${fixed(100 * (now / then - 1), 1)} %`;
  return (
    <Table
      withRowBorders={false}
      verticalSpacing={2}
      aria-label={fillText(TEXTS.estimatesOf, { side: motor.side })}
    >
      <Table.Thead>
        <Table.Tr>
          <Table.Th />
          <Table.Th className={page.number}>
            <SignalName name="K_m" /> [rad/(V·s)]
          </Table.Th>
          <Table.Th className={page.number}>
            <SignalName name="T_m" /> [s]
          </Table.Th>
          <Table.Th className={page.number}>
            <SignalName name="u_c" /> [V]
          </Table.Th>
        </Table.Tr>
      </Table.Thead>
      <Table.Tbody>
        <Line
          title={TEXTS.leastSquares}
          K={significant(fitted.K_m, 4)}
          T={significant(fitted.T_m, 4)}
          u={significant(motor.u_c, 3)}
        />
        <Line
          title={TEXTS.motorStandardError}
          K={significant(std_errors.K_m, 2)}
          T={significant(std_errors.T_m, 2)}
          u={significant(motor.u_c_std, 2)}
        />
        <Line
          title={TEXTS.ruleMean}
          K={significant(rule_mean.K_m, 4)}
          T={significant(rule_mean.T_m, 4)}
          u={BY_THE_RULE}
        />
        <Line
          title={TEXTS.ruleSpread}
          K={significant(rule_spread.K_m, 2)}
          T={significant(rule_spread.T_m, 2)}
          u={BY_THE_RULE}
        />
        <Line
          title={TEXTS.usedDuringRun}
          K={significant(before.K_m, 4)}
          T={significant(before.T_m, 4)}
          u={NOT_IN_FORCE}
        />
        <Line
          title={TEXTS.deviation}
          K={change(fitted.K_m, before.K_m)}
          T={change(fitted.T_m, before.T_m)}
          u={NOT_IN_FORCE}
        />
      </Table.Tbody>
    </Table>
  );
}

const BY_THE_RULE = <Absent why={TEXTS.notByRule} />;
const NOT_IN_FORCE = <Absent why={TEXTS.notForGains} />;

function Line({ title, K, T, u }: { title: string; K: string; T: string; u: ReactNode }) {
  return (
    <Table.Tr>
      <Table.Td>{title}</Table.Td>
      <Table.Td className={page.number}>{K}</Table.Td>
      <Table.Td className={page.number}>{T}</Table.Td>
      <Table.Td className={page.number}>{u}</Table.Td>
    </Table.Tr>
  );
}

function Steps({ curves }: { curves: MotorCurves | undefined }) {
  const angles = useAngleUnit();
  if (curves === undefined) return null;
  const [turn, apart] = [readingOf("rad", angles), readingOf("mrad", angles)];
  const read = (value: number) => value * turn.factor;
  const hue = SIDE_HUES[curves.side];
  const turns = curves.steps.flatMap((step, index): Curve[] => [
    { label: TEXTS.measured, quiet: index > 0, colour: hue, x: step.t, y: step.measured.map(read) },
    {
      label: TEXTS.modelCurve,
      quiet: index > 0,
      colour: "text",
      line: "dashed",
      x: step.t,
      y: step.model.map(read),
    },
  ]);
  const left = curves.steps.map((step) => ({
    label: withUnit(String(step.voltage), "V"),
    quiet: true,
    colour: hue,
    x: step.t,
    y: step.measured.map((value, index) => apart.factor * 1000 * (value - (step.model[index] ?? Number.NaN))),
  }));
  return (
    <>
      <CurvePlot
        title={fillText(TEXTS.motorAngle, { side: curves.side })}
        xLabel={TEXTS.timeFromStep}
        yLabel={turn.unit}
        summary={fillText(TEXTS.stepsTo, {
          voltages: curves.steps.map((step) => withUnit(String(step.voltage), "V")).join(", "),
        })}
        curves={turns}
      />
      <CurvePlot
        title={TEXTS.measuredMinusModel}
        xLabel={TEXTS.timeFromStep}
        yLabel={apart.unit}
        height={130}
        summary={TEXTS.differenceSummary}
        curves={left}
      />
    </>
  );
}
