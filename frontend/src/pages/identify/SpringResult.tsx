import { Button, FileInput, Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { CurvePlot } from "../../charts/CurvePlot";
import { Card } from "../../components/Card";
import { ChoiceField, TextField } from "../../components/fields";
import { Refusal } from "../../components/Refusal";
import { Verdict } from "../../components/RunState";
import { ValueOrReason } from "../../components/values";
import { dateTime, fixed, withError } from "../../samples/format";
import { withUnit } from "../../samples/quantity";
import { countThings, fillText } from "../../samples/texts";
import { curvesQuery, springTableCurvesQuery, useAddSpringTable } from "../../service/api/identifications";
import { RefusedFields, useRefusedInput } from "../../service/forms/refusals";
import { HUES } from "../../theme/signals";
import type { Identification, Spring, SpringCurves, SpringTable, SpringTableReading } from "../../wire/types";
import pageStyles from "../Page.module.css";
import identifyStyles from "./Identify.module.css";
import { ApplyParameters } from "./ParametersCard";
import { TEXTS } from "./texts";

const MILLI = 1000;
const ORDER_COLOURS: Record<number, string> = { 2: "text", 3: HUES.u_B, 5: HUES.u_A };

/** Formats an error of a fit, which may be null. */
function errorText(value: number | null, decimals: number): string {
  return fixed(value ?? Number.NaN, decimals);
}

export function SpringRunResult({ identification }: { identification: Identification }) {
  const curves = useQuery(curvesQuery(identification.run));
  return (
    <div className={pageStyles.halves}>
      {identification.springs.map((spring) => (
        <SpringView
          key={spring.name}
          title={fillText(TEXTS.spring, { name: spring.name })}
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
    <Card title={TEXTS.springFromTable}>
      <p className={pageStyles.lead}>
        {fillText(TEXTS.tableLead, {
          file: table.file,
          time: dateTime(table.created),
          person: table.who,
          checksum: table.sha256.slice(0, 12),
        })}
      </p>
      {table.read && <p className={pageStyles.lead}>{readingOf(table.read)}</p>}
      <Verdict good={table.usable}>{table.message}</Verdict>
      <SpringView title={table.file} hue={HUES.F_A} spring={table.spring} curves={curves.data?.springs[0]} />
      <ApplyParameters estimate={table.id} />
    </Card>
  );
}

/** Describes the contents of the file. */
function readingOf(read: SpringTableReading): string {
  const lines = (count: number) => countThings(count, "line");
  const sentences = [
    fillText(TEXTS.tableRead, {
      x_unit: read.x_unit,
      F_unit: read.F_unit,
      rows: countThings(read.rows, "row"),
      line: read.heading_line,
      separator: read.separator,
      mark: read.decimal_mark,
    }),
    read.lines_above_heading > 0 && fillText(TEXTS.linesAbove, { lines: lines(read.lines_above_heading) }),
    read.comment_lines > 0 && fillText(TEXTS.commentLines, { lines: lines(read.comment_lines) }),
    ...read.not_read.map(({ name, reason }) => fillText(TEXTS.columnNotRead, { name, reason })),
    ...read.notes.map((note) => fillText(TEXTS.tableNote, { note })),
  ];
  return sentences.filter((sentence) => sentence !== false).join(" ");
}

interface SpringViewProps {
  readonly title: string;
  readonly hue: string;
  readonly spring: Spring;
  readonly curves: SpringCurves | undefined;
}

function SpringView({ title, hue, spring, curves }: SpringViewProps) {
  const pairs = countThings(spring.pairs, "pair");
  return (
    <section className={identifyStyles.model} aria-label={title}>
      <h3 className={identifyStyles.heading}>{title}</h3>
      <Table withRowBorders={false} verticalSpacing={2} aria-label={fillText(TEXTS.polynomialsOf, { title })}>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>{TEXTS.order}</Table.Th>
            <Table.Th className={pageStyles.number}>{TEXTS.rms}</Table.Th>
            <Table.Th className={pageStyles.number}>{TEXTS.maxError}</Table.Th>
            <Table.Th className={pageStyles.number}>{TEXTS.crossValidation}</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {spring.fits.map((fit) => (
            <Table.Tr key={fit.order} fw={fit.order === spring.recommended ? 600 : undefined}>
              <Table.Td>
                {fit.order === spring.recommended
                  ? fillText(TEXTS.recommended, { order: fit.order })
                  : fit.order}
              </Table.Td>
              <Table.Td className={pageStyles.number}>{errorText(fit.rms_N, 3)}</Table.Td>
              <Table.Td className={pageStyles.number}>{errorText(fit.max_N, 3)}</Table.Td>
              <Table.Td className={pageStyles.number}>{errorText(fit.cross_validation_N, 3)}</Table.Td>
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
      <span className={pageStyles.dim}>
        {spring.hysteresis_N === null
          ? fillText(TEXTS.fitReason, { reason: spring.reason, pairs })
          : fillText(TEXTS.fitReasonHysteresis, {
              reason: spring.reason,
              pairs,
              hysteresis: withUnit(fixed(spring.hysteresis_N, 2), "N"),
            })}
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
    <Table withRowBorders={false} verticalSpacing={2} aria-label={fillText(TEXTS.coefficientsOf, { title })}>
      <Table.Caption>{TEXTS.coefficients}</Table.Caption>
      <Table.Thead>
        <Table.Tr>
          <Table.Th>
            k<sub>i</sub> [N/mⁱ]
          </Table.Th>
          {spring.fits.map((fit) => (
            <Table.Th key={fit.order} className={pageStyles.number}>
              {fillText(TEXTS.orderItem, { order: fit.order })}
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
              <Table.Td key={fit.order} className={pageStyles.number} style={{ whiteSpace: "nowrap" }}>
                <ValueOrReason value={fit.k[power]} why={fillText(TEXTS.noCoefficient, { order: fit.order })}>
                  {(k) => withError(k, fit.std_errors[power] ?? Number.NaN)}
                </ValueOrReason>
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
        title={TEXTS.forceOverElongation}
        xLabel="x [mm]"
        yLabel="F [N]"
        summary={fillText(TEXTS.forceSummary, {
          pairs: countThings(spring.pairs, "pair"),
          order: spring.recommended,
        })}
        curves={[
          { label: TEXTS.pairs, colour: hue, line: "none", points: true, x: millimetres, y: curves.F },
          {
            label: fillText(TEXTS.orderItem, { order: spring.recommended }),
            colour: "text",
            x: curves.curve_x.map((x) => MILLI * x),
            y: recommended?.force ?? [],
          },
        ]}
      />
      <CurvePlot
        title={TEXTS.measuredMinusFitted}
        xLabel="x [mm]"
        yLabel="N"
        summary={fillText(TEXTS.errorsSummary, {
          errors: spring.fits
            .map(({ max_N, order }) =>
              fillText(TEXTS.errorAtOrder, { error: withUnit(errorText(max_N, 2), "N"), order }),
            )
            .join(", "),
        })}
        curves={curves.orders.map((order) => ({
          label: fillText(TEXTS.orderItem, { order: order.order }),
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

const DECIMALS = [
  { value: "", label: TEXTS.decimalDetected },
  { value: "point", label: TEXTS.decimalPoint },
  { value: "comma", label: TEXTS.decimalComma },
];

export function SpringTableForm({ onTable }: { onTable: (id: number) => void }) {
  const add = useAddSpringTable();
  const [file, setFile] = useState<File | null>(null);
  const [decimal, setDecimal] = useState("");
  const [header, setHeader] = useState("");

  const isLine = /^([1-9]\d{0,5})?$/.test(header);

  async function read(chosen: File | null): Promise<void> {
    setFile(chosen);
    if (chosen === null || !isLine) return;
    const body = {
      name: chosen.name,
      table: await chosen.text(),
      decimal: decimal === "point" || decimal === "comma" ? decimal : null,
      header: header === "" ? null : Number(header),
    } as const;
    add.mutate(body, { onSuccess: (table) => onTable(table.id) });
  }

  return (
    <RefusedFields error={add.error} only="table">
      <form
        className={pageStyles.fields}
        aria-label={TEXTS.measuredTable}
        onSubmit={(event) => event.preventDefault()}
      >
        <TableFile reading={add.isPending} onChange={read} />
        <ChoiceField
          name="decimal"
          label={TEXTS.decimalMark}
          data={DECIMALS}
          value={decimal}
          onChange={setDecimal}
        />
        <TextField
          name="header"
          label={TEXTS.headingLine}
          description={TEXTS.headingDetected}
          value={header}
          problem={isLine ? null : TEXTS.notALine}
          onChange={(text) => setHeader(text.trim())}
        />
        {add.isError && file !== null && (
          <Button variant="default" loading={add.isPending} onClick={() => read(file)}>
            {fillText(TEXTS.readAgain, { file: file.name })}
          </Button>
        )}
        <Refusal error={add.error} />
      </form>
    </RefusedFields>
  );
}

function TableFile({ reading, onChange }: { reading: boolean; onChange: (file: File | null) => void }) {
  const { ref, said } = useRefusedInput<HTMLButtonElement>("table");
  return (
    <FileInput
      ref={ref}
      label={TEXTS.tableFile}
      description={TEXTS.tableColumns}
      inputWrapperOrder={["label", "input", "description", "error"]}
      placeholder={TEXTS.chooseFile}
      accept=".csv,text/csv,text/plain"
      value={null}
      error={said}
      disabled={reading}
      onChange={onChange}
    />
  );
}

interface SpringTableListProps {
  readonly tables: readonly SpringTable[];
  readonly selected: number | null;
  onSelect(id: number | null): void;
}

export function SpringTableList({ tables, selected, onSelect }: SpringTableListProps) {
  if (tables.length === 0) return null;
  return (
    <Card title={TEXTS.springsFromTables}>
      <div className={pageStyles.tableScroll}>
        <Table aria-label={TEXTS.springsFromTables}>
          <Table.Tbody>
            {tables.map((table) => (
              <Table.Tr key={table.id} bg={table.id === selected ? "var(--accent-soft)" : undefined}>
                <Table.Td>{table.file}</Table.Td>
                <Table.Td style={{ whiteSpace: "nowrap" }}>{dateTime(table.created)}</Table.Td>
                <Table.Td>{fillText(TEXTS.orderItem, { order: table.spring.recommended })}</Table.Td>
                <Table.Td>{table.usable ? TEXTS.usable : TEXTS.notUsable}</Table.Td>
                <Table.Td className={pageStyles.number}>
                  <Button
                    size="compact-xs"
                    variant="default"
                    aria-label={fillText(table.id === selected ? TEXTS.closeTable : TEXTS.showTable, {
                      file: table.file,
                    })}
                    onClick={() => onSelect(table.id === selected ? null : table.id)}
                  >
                    {table.id === selected ? TEXTS.close : TEXTS.show}
                  </Button>
                </Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </div>
    </Card>
  );
}
