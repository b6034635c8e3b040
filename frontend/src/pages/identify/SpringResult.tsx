/** Springs: polynomials of several orders, which one to use and why, with pairs and error curves. */

import { Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { CurvePlot } from "../../charts/CurvePlot";
import { Shown } from "../../components/Absent";
import { Card } from "../../components/Card";
import { Verdict } from "../../components/Verdict";
import { dateTime, fixed, withError } from "../../samples/format";
import { curvesQuery, springTableCurvesQuery } from "../../service/queries";
import { HUES } from "../../theme/signals";
import type { Identification, Spring, SpringCurves, SpringTable, SpringTableReading } from "../../wire/types";
import page from "../Page.module.css";
import { ApplyParameters } from "./ApplyParameters";
import styles from "./Identify.module.css";

const MILLI = 1000;
const ORDER_COLOURS: Record<number, string> = { 2: "text", 3: HUES.u_B, 5: HUES.u_A };

export function SpringRunResult({ identification }: { identification: Identification }) {
  const curves = useQuery(curvesQuery(identification.run));
  return (
    <div className={page.halves}>
      {identification.springs.map((spring) => (
        <SpringView
          key={spring.name}
          title={`Spring ${spring.name}`}
          hue={spring.name === "A" ? HUES.F_A : HUES.F_B}
          spring={spring}
          curves={curves.data?.springs.find((drawn) => drawn.name === spring.name)}
        />
      ))}
    </div>
  );
}

export function SpringTableResult({ table }: { table: SpringTable }) {
  const curves = useQuery(springTableCurvesQuery(table.id));
  return (
    <Card title="Spring from a table">
      <p className={page.lead}>
        {table.file}, {dateTime(table.created)} by {table.who}. Digest {table.sha256.slice(0, 12)}.
      </p>
      {table.read && <p className={page.lead}>{readingOf(table.read)}</p>}
      <Verdict good={table.usable}>{table.message}</Verdict>
      <SpringView title={table.file} hue={HUES.F_A} spring={table.spring} curves={curves.data?.springs[0]} />
      <ApplyParameters estimate={table.id} />
    </Card>
  );
}

/** What was read of the file, in a few sentences. */
function readingOf(read: SpringTableReading): string {
  const above =
    read.lines_above_heading > 0 ? ` ${read.lines_above_heading} lines above it are not read.` : "";
  const comments = read.comment_lines > 0 ? ` ${read.comment_lines} lines of comments are not read.` : "";
  const others = read.not_read.map(({ name, reason }) => ` Not read: ${name} (${reason}).`).join("");
  const notes = read.notes.map((note) => ` Note: ${note}.`).join("");
  return (
    `Read: x [${read.x_unit}] and F [${read.F_unit}], ${read.rows} rows; names in line ${read.heading_line}, ` +
    `separator ${read.separator}, decimal ${read.decimal_mark}.${above}${comments}${others}${notes}`
  );
}

interface SpringViewProps {
  readonly title: string;
  readonly hue: string;
  readonly spring: Spring;
  readonly curves: SpringCurves | undefined;
}

function SpringView({ title, hue, spring, curves }: SpringViewProps) {
  return (
    <section className={styles.model} aria-label={title}>
      <h3 className={styles.heading}>{title}</h3>
      <Table withRowBorders={false} verticalSpacing={2} aria-label={`Polynomials of ${title}`}>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>Order</Table.Th>
            <Table.Th className={page.number}>RMS [N]</Table.Th>
            <Table.Th className={page.number}>Largest [N]</Table.Th>
            <Table.Th className={page.number}>Left out [N]</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {spring.fits.map((fit) => (
            <Table.Tr key={fit.order} fw={fit.order === spring.recommended ? 600 : undefined}>
              <Table.Td>{fit.order === spring.recommended ? `${fit.order}, use this` : fit.order}</Table.Td>
              <Table.Td className={page.number}>{fixed(fit.rms_N, 3)}</Table.Td>
              <Table.Td className={page.number}>{fixed(fit.max_N, 3)}</Table.Td>
              <Table.Td className={page.number}>{fixed(fit.cross_validation_N, 3)}</Table.Td>
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
      <span className={page.dim}>
        {spring.reason}; {spring.pairs} pairs
        {spring.hysteresis_N !== null &&
          `; the ways up and down differ by up to ${fixed(spring.hysteresis_N, 2)} N`}
        .
      </span>
      <Coefficients title={title} spring={spring} />
      {curves && <Drawings spring={spring} curves={curves} hue={hue} />}
    </section>
  );
}

function Coefficients({ title, spring }: { title: string; spring: Spring }) {
  const highest = Math.max(...spring.fits.map((fit) => fit.order));
  const powers = Array.from({ length: highest + 1 }, (_, power) => power);
  return (
    <Table withRowBorders={false} verticalSpacing={2} aria-label={`Coefficients of ${title}`}>
      <Table.Caption>Coefficients with standard errors</Table.Caption>
      <Table.Thead>
        <Table.Tr>
          <Table.Th>
            k<sub>i</sub> [N/mⁱ]
          </Table.Th>
          {spring.fits.map((fit) => (
            <Table.Th key={fit.order} className={page.number}>
              order {fit.order}
            </Table.Th>
          ))}
        </Table.Tr>
      </Table.Thead>
      <Table.Tbody>
        {powers.map((power) => (
          <Table.Tr key={power}>
            <Table.Td>
              k<sub>{power}</sub>
            </Table.Td>
            {spring.fits.map((fit) => (
              <Table.Td key={fit.order} className={page.number} style={{ whiteSpace: "nowrap" }}>
                <Shown value={fit.k[power]} why={`order ${fit.order} has none`}>
                  {(k) => withError(k, fit.std_errors[power] ?? Number.NaN)}
                </Shown>
              </Table.Td>
            ))}
          </Table.Tr>
        ))}
      </Table.Tbody>
    </Table>
  );
}

function Drawings({ spring, curves, hue }: { spring: Spring; curves: SpringCurves; hue: string }) {
  const millimetres = curves.x.map((x) => MILLI * x);
  const recommended = curves.orders.find((order) => order.order === spring.recommended);
  return (
    <>
      <CurvePlot
        title="Force over elongation"
        xLabel="x [mm]"
        yLabel="F [N]"
        summary={`${spring.pairs} pairs and the polynomial of order ${spring.recommended}.`}
        curves={[
          { label: "pairs", colour: hue, line: "none", points: true, x: millimetres, y: curves.F },
          {
            label: `order ${spring.recommended}`,
            colour: "text",
            x: curves.curve_x.map((x) => MILLI * x),
            y: recommended?.force ?? [],
          },
        ]}
      />
      <CurvePlot
        title="Measured minus fitted"
        xLabel="x [mm]"
        yLabel="N"
        summary={`Largest error ${spring.fits.map((fit) => `${fixed(fit.max_N, 2)} N at order ${fit.order}`).join(", ")}.`}
        curves={curves.orders.map((order) => ({
          label: `order ${order.order}`,
          colour: ORDER_COLOURS[order.order] ?? "limit",
          line: "none",
          points: true,
          x: millimetres,
          y: order.errors,
        }))}
      />
    </>
  );
}
