/** One fitted model with its quality: gain against geometry, lag, fit, parameters, verdict. */

import { Table } from "@mantine/core";
import { Shown } from "../../components/Absent";
import { Explained } from "../../components/Explained";
import { SignalName } from "../../components/SignalName";
import { Verdict } from "../../components/Verdict";
import { fixed, percent, significant } from "../../samples/format";
import { capital, inWordsOf, structureInWords } from "../../samples/words";
import { symbolEntry } from "../../service/glossary";
import type { Model } from "../../wire/types";
import page from "../Page.module.css";
import styles from "./Identify.module.css";

export function ModelView({
  name,
  path,
  unit,
  model,
  isExplained,
}: {
  name: string;
  path: string;
  unit: string;
  model: Model;
  /** The verdict on the whole identification has the reasons of this model's grade already. */
  isExplained: boolean;
}) {
  const deviation = 100 * (model.K / model.gain_geometry - 1);
  const sign = deviation > 0 ? "+" : "";
  return (
    <section className={styles.model} aria-label={`Model ${name}`}>
      <h3 className={styles.heading}>
        <SignalName name={name} /> <span className={page.dim}>{path}</span>
      </h3>
      <dl className={styles.figures}>
        <div>
          <dt>
            <Explained of="quantity:K">Gain K</Explained> {unit !== "" && `[${unit}]`}
          </dt>
          <dd>{significant(model.K, 4)}</dd>
          <dd className={styles.beside}>
            geometry {significant(model.gain_geometry, 3)}, {sign}
            {fixed(deviation, 1)} %
          </dd>
        </div>
        <div>
          <dt>
            <Explained of="quantity:T">Sum of lags T</Explained> [s]
          </dt>
          <dd>{significant(model.T, 3)}</dd>
          <dd className={styles.beside}>first-order reduction</dd>
        </div>
        <div>
          <dt>
            <Explained of="quantity:fit_percent">Fit</Explained> [%]
          </dt>
          <dd>
            <Shown value={model.fit_percent} why="not measured: no data was left aside">
              {(fit) => percent(fit, 1)}
            </Shown>
          </dd>
          <dd className={styles.beside}>on data not used</dd>
        </div>
      </dl>
      <Table withRowBorders={false} verticalSpacing={2} aria-label={`Parameters of ${name}`}>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>{structureInWords(model.structure)}</Table.Th>
            <Table.Th className={page.number}>Value</Table.Th>
            <Table.Th className={page.number}>Standard error</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {Object.entries(model.parameters).map(([parameter, value]) => (
            <Table.Tr key={parameter}>
              <Table.Td>
                <Explained of={symbolEntry(parameter)}>{parameter}</Explained>
              </Table.Td>
              <Table.Td className={page.number}>{significant(value, 4)}</Table.Td>
              <Table.Td className={page.number}>
                <Shown value={model.std_errors[parameter]} why="not determined by this record">
                  {(error) => significant(error, 2)}
                </Shown>
              </Table.Td>
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
      <span className={page.dim}>Estimated by {inWordsOf(model.method)}.</span>
      <Verdict good={model.grade === "usable"} of={`grade:${model.grade}`}>
        {isExplained ? capital(model.grade) : model.verdict}
      </Verdict>
    </section>
  );
}
