"""Points as text, as programs write them."""

from __future__ import annotations

from tests.support.corpus_case import cloud_case as _case

INTENSITY = {"Intensity": [7, 8]}


GERMAN = "x,y,z,Intensität\n1,2,3,7\n4,5,6,8\n"
"""A header that is not ASCII."""


_NAMED = "{0}1{0}2{0}3{0}7\n{0}4{0}5{0}6{0}8\n"
"""Lines that begin with an index or an empty value."""

CASES = [
    _case("plain.xyz", "1 2 3\n4 5 6\n"),
    _case("empty.xyz", "", error="empty.xyz: the cloud is empty"),
    _case("names_alone.csv", "x,y,z\n", error="names_alone.csv: the cloud is empty"),
    # Names and separators
    _case(
        "blank_in_a_name.csv",
        "Point ID,X,Y,Z,Intensity\n9,1,2,3,7\n9,4,5,6,8\n",
        fields={"Point ID": [9, 9], **INTENSITY},
    ),
    _case(
        "blank_in_a_name_tabs.txt",
        "Point ID\tX\tY\tZ\tIntensity\n9\t1\t2\t3\t7\n9\t4\t5\t6\t8\n",
        fields={"Point ID": [9, 9], **INTENSITY},
    ),
    _case("pandas_index.csv", ",x,y,z,Intensity\n0,1,2,3,7\n1,4,5,6,8\n", fields=INTENSITY),
    _case("cloudcompare.asc", "//X,Y,Z,Intensity\n1,2,3,7\n4,5,6,8\n", fields=INTENSITY),
    _case("cloudcompare_count.asc", "//X Y Z Intensity\n2\n1 2 3 7\n4 5 6 8\n", fields=INTENSITY),
    _case("savetxt.txt", "# x, y, z, Intensity\n1 2 3 7\n4 5 6 8\n", fields=INTENSITY),
    _case("surveyed.csv", "Easting,Northing,Height\n1,2,3\n4,5,6\n"),
    _case("surveyed_order.csv", "Northing;Easting;Elevation\n2;1;3\n5;4;6\n"),
    _case("paraview.csv", '"Points:0","Points:1","Points:2","Intensity"\n1,2,3,7\n4,5,6,8\n'),
    _case("paraview_5_11.csv", "Intensity,Points_0,Points_1,Points_2\n7,1,2,3\n8,4,5,6\n"),
    _case(
        "veloview.csv",
        '"Intensity","Points_m_XYZ:0","Points_m_XYZ:1","Points_m_XYZ:2"\n7,1,2,3\n8,4,5,6\n',
        fields=INTENSITY,
    ),
    _case("unit_in_names.csv", "X [m],Y [m],Z [m]\n1,2,3\n4,5,6\n"),
    _case("order_of_columns.txt", "z y x\n3 2 1\n6 5 4\n"),
    _case("units_below_names.csv", "x,y,z\nm,m,m\n1,2,3\n4,5,6\n"),
    _case("title_above_names.csv", "Scan of a room\nx,y,z\n1,2,3\n4,5,6\n"),
    _case("quoted.csv", '"x","y","z"\n"1","2","3"\n"4","5","6"\n'),
    _case("joined.csv", "x,y,z\n1,2,3\nx,y,z\n4,5,6\n"),
    _case("byte_order_mark.csv", "\ufeffx,y,z\n1,2,3\n4,5,6\n"),
    _case("accents.csv", "Höhe,x,y,z\n7,1,2,3\n8,4,5,6\n", fields={"Höhe": [7, 8]}),
    _case("utf16.csv", "x,y,z\n1,2,3\n4,5,6\n".encode("utf-16")),
    _case(
        "numbers_of_columns.csv",
        "0,1,2\n1.5,2,3\n4,5,6\n",
        [(1.5, 2, 3), (4, 5, 6)],
        warning="numbers_of_columns.csv: its first line numbers the columns, and is not a point",
    ),
    _case(
        "numbers_of_columns_and_rows.csv",
        ",0,1,2\n0,1,2,3\n1,4,5,6\n",
        warning="its first line numbers the columns",
    ),
    _case("first_point_7_0_1.csv", "7,0,1,2\n4,5.5,6,1\n", [(7, 0, 1), (4, 5.5, 6)]),
    _case(
        "text_with_blanks_tabs.txt",
        "x\ty\tz\twho\n1\t2\t3\tAnn Lee\n4\t5\t6\tBob\n",
        warning="left out: who",
    ),
    _case("aligned_by_tabs.xyz", "1\t\t2\t3\n4\t\t5\t6\n"),
    _case("numbers_between_tabs.xyz", "1 2\t3\n4 5\t6\n"),
    _case("first_point_0_1_2.csv", "0,1,2\n4,5,6\n", [(0, 1, 2), (4, 5, 6)]),
    # Numbers
    _case("decimal_comma.csv", "x;y;z\n1,5;2;3\n4;5,25;6\n", [(1.5, 2, 3), (4, 5.25, 6)]),
    _case("decimal_comma_blanks.xyz", "1,5 2,0 3,0\n4,0 5,25 6,0\n", [(1.5, 2, 3), (4, 5.25, 6)]),
    _case("decimal_comma_tabs.txt", "1\t2\t3\n4,5\t5\t6\n", [(1, 2, 3), (4.5, 5, 6)]),
    _case("nearest_double.xyz", "0.1 1e-3 +2.5E2\n-.5 3. 1\n", [(0.1, 0.001, 250), (-0.5, 3, 1)]),
    _case(
        "whole_then_broken.csv",
        "x,y,z\n" + "1,1,1\n" * 3 + "0.5,1,1\n",
        [(1, 1, 1)] * 3 + [(0.5, 1, 1)],
    ),
    _case(
        "large_numbers.xyz",
        "500000.123 5400000.456 1\n1 2 3\n",
        [(500000.123, 5400000.456, 1), (1, 2, 3)],
    ),
    _case(
        "not_finite.xyz", "1 2 nan\n4 5 6\n", error="1 of 2 points are not finite .*--drop-invalid"
    ),
    _case(
        "not_finite_dropped.xyz",
        "1 2 inf\n1 2 3\n4 5 6\n",
        options={"drop_invalid": True},
        warning="not_finite_dropped.xyz: 1 of 3 points are not finite: left out",
    ),
    # Decimal commas, and thousands
    *(
        _case(f"commas_twice_{number}.csv", lines, error="csv: commas separate its numbers and")
        for number, lines in enumerate(
            [
                "1,5, 2,5, 3,5\n4,5, 5,5, 6,5\n",
                "1,5, 2, 3\n4,5, 5, 6\n",
                "1, 2, 3,5\n4, 5, 6,5\n",
                "1,5,\t2,5,\t3,5\n",
                "7, 1,5, 2,5, 3,5\n",
            ]
        )
    ),
    _case("commas_and_blanks.csv", "1, 2, 3\n4, 5, 6\n"),
    _case("one_decimal.csv", "1,5,2,5,3,5\n4,5,5,5,6,5\n", error="six numbers, or three. If"),
    _case("six_integers.csv", "1,2,3,200,0,0\n4,5,6,0,10,0\n"),
    _case(
        "grouped_by_blanks.csv",
        "1,2,3, 7,8,9\n4,5,6, 70,8,9\n",
        warning=None,
    ),
    _case(
        "commas_twice_named.csv",
        "x, y, z\n1,5, 2,5, 3,5\n",
        error="3 names .* for 6 columns: do commas separate decimals, too",
    ),
    _case(
        "decimal_comma_quoted.csv",
        '"x","y","z"\n"1,5",2,"3,25"\n"4","5,5","6"\n',
        [(1.5, 2, 3.25), (4, 5.5, 6)],
    ),
    _case("decimal_comma_quoted_alone.csv", '"1,5","2","3,25"\n', [(1.5, 2, 3.25)]),
    _case("decimal_comma_integers.xyz", "1 2,5 3 7\n4,0 5 6 8\n", [(1, 2.5, 3), (4, 5, 6)]),
    _case(
        "decimal_comma_late.csv",
        "x;y;z\n" + "1;2;3\n" * 20000 + "4,5;5;6\n",
        [(1, 2, 3)] * 20000 + [(4.5, 5, 6)],
    ),
    _case(
        "decimal_comma_in_words.csv",
        "x;y;z;who\n1.5;2;3;at 1,5 m\n4;5;6;Bob\n",
        [(1.5, 2, 3), (4, 5, 6)],
        warning="left out: who",
    ),
    _case(
        "decimal_comma_and_point.csv",
        "x;y;z\n1,5;2.5;3\n4;5;6\n",
        error="column y has '2.5', but other decimals follow commas",
    ),
    _case(
        "thousands_or_decimals.csv",
        'x,y,z\n"1,234","5,678",3\n',
        error="'1,234' may be 1234 or 1.234: write it so",
    ),
    _case(
        "millimetres.csv",
        "x;y;z\n1,234;5,678;3,000\n4,000;5,000;6,001\n",
        [(1.234, 5.678, 3), (4, 5, 6.001)],
        warning="millimetres.csv: its commas are read as decimal commas: 1,234 is 1.234",
    ),
    _case("millimetres_below_1.csv", "x;y;z\n1,234;0,678;3,000\n", [(1.234, 0.678, 3)]),
    *(
        _case(
            f"thousands_{number}.csv",
            f'x;y;z\n1;2;3\n"{value}";2;3\n',
            error="column x has .*: write numbers without separators of thousands",
        )
        for number, value in enumerate(
            ["1,234.5", "1.234,5", "1 234,5", "1\u00a0234", "1\u202f234,5", "1'234.5", "1.234.567"]
        )
    ),
    # Other numbers
    _case(
        "fortran.xyz",
        "x y z id\n 1.0D+00 0.2D1 3.D0 3d5\n 4.0D0 5.0d0 6.D+0 a\n",
        warning="left out: id",
    ),
    _case(
        "words_for_nan.csv",
        "x,y,z,Intensity\n1,2,3,#N/A\n4,5,6,8\n",
        fields={"Intensity": [float("nan"), 8]},
    ),
    _case("first_point_without_x.csv", "x,y,z\nN/A,2,3\n4,5,6\n", error="1 of 2 points are not f"),
    _case(
        "minus_of_word_processors.csv", "x,y,z\n\u22121,2,3\n4,5,6\n", error="begins '\u22121,2,3'"
    ),
    _case("damaged_first_point.csv", "x,y,z\n1,--,3\n4,5,6\n", error="begins '1,--,3'"),
    _case("only_damaged.csv", "x,y,z\n1|2|3\n4|5|6\n", error="a line begins '1.2.3'"),
    _case("lists.txt", "[1, 2, 3]\n[4, 5, 6]\n", error="a line begins '.1, 2, 3.'"),
    _case(
        "long_ids.csv",
        "x,y,z,id\n1,2,3,9007199254740993\n4,5,6,\n",
        warning="numbers from 2\\^53 on are rounded: id",
    ),
    _case(
        "six_columns_no_normals.xyz",
        "1 2 3 0.5 0.25 1\n4 5 6 0 0 0.5\n",
        fields={"column_4": [0.5, 0], "column_5": [0.25, 0], "column_6": [1, 0.5]},
    ),
    # Names
    *(
        _case(f"intensity_{encoding}.csv", GERMAN.encode(encoding), fields={"Intensität": [7, 8]})
        for encoding in ("utf-8", "utf-8-sig", "latin-1", "utf-16")
    ),
    _case("euro_cp1252.csv", "x,y,z,€\n1,2,3,7\n4,5,6,8\n".encode("cp1252"), fields={"€": [7, 8]}),
    _case(
        "same_words.csv",
        "x,y,z,gps time,gps_time\n1,2,3,7,9\n4,5,6,8,9\n",
        fields={"gps time": [7, 8], "gps_time": [9, 9]},
    ),
    _case(
        "label_and_label_.csv",
        "x,y,z,label,label_\n1,2,3,0.5,7\n4,5,6,1,8\n",
        fields={"label_": [7, 8], "label__": [0.5, 1]},
    ),
    _case(
        "millimetres_below_names.csv",
        "x,y,z\nmm,mm,mm\n1,2,3\n4,5,6\n",
        warning="its unit, mm, is not applied: use --metres-per-unit",
    ),
    _case(
        "empty_cells_tabs.txt",
        "x\ty\tz\tIntensity\ttime\n1\t2\t3\t\t9\n4\t5\t6\t\t9\n",
        fields={"time": [9, 9]},
    ),
    _case("trailing_comma_and_blank.csv", "1, 2, 3, \n4, 5, 6, \n"),
    _case("long_line.xyz", "# " + "x" * 200_000 + "\n1 2 3\n4 5 6\n"),
    _case("long_title.xyz", "x" * 200_000 + "\n1 2 3\n4 5 6\n", error="0 names .* for 3 columns"),
    # Lines
    _case("crlf.xyz", "1 2 3 \r\n4 5 6 \r\n"),
    _case("cr.xyz", "1 2 3\r4 5 6\r"),
    _case("blank_lines.csv", "\n\nx,y,z\n\n1,2,3\n  \n4,5,6\n\n"),
    _case("indented.xyz", "  1\t 2   3\n\t4 5 6\n"),
    _case("trailing_separators.csv", "x,y,z,\n1,2,3,\n4,5,6,\n"),
    _case("trailing_separators_of_points.csv", "x,y,z\n1,2,3,\n4,5,6,\n"),
    _case("trailing_separators_of_names.csv", "x,y,z,,\n1,2,3\n4,5,6\n"),
    _case("trailing_separators_alone.csv", "1,2,3,\n4,5,6,\n"),
    _case("comments.xyz", "# x y\n1 2 3\n# in the middle\n // another\n4 5 6\n# end"),
    _case("empty_column.csv", "x,empty,y,z\n1,,2,3\n4,,5,6\n"),
    _case(
        "words.csv",
        "x,y,z,who\n1,2,3,Ann\n4,5,6,Bob\n",
        warning="columns without numbers are left out: who",
    ),
    _case("several_scans.pts", "1\n1 2 3 7\n1\n4 5 6 8\n", fields={"intensity": [7, 8]}),
    _case("long_comments.xyz", "# a comment\n" * 9000 + "1 2 3\n4 5 6\n"),
    # Refused
    _case("no_count.pts", "9" * 5000 + "\n1 2 3\n", error="not a table of numbers"),
    _case("two_scans_cut.pts", "1\n1 2 3\n2\n4 5 6\n", error="2 points, but its header says 3"),
    _case("fewer_points.pts", "3\n1 2 3\n4 5 6\n", error="2 points, but its header says 3"),
    _case("too_few_names.csv", "x,y,z\n1,2,3,4\n", error="3 names .* for 4 columns"),
    _case("too_many_names.csv", "x,y,z,w\n1,2,3\n", error="4 names .* for 3 columns"),
    _case("names_of_r.txt", 'x y z\n"1" 1 2 3\n', error="3 names .* for 4 columns"),
    _case(
        "too_many_names_in_a_comment.xyz", "# y x z w\n1 2 3\n", error="4 names .* for 3 columns"
    ),
    _case(
        "numbered.csv",
        "1,0.5,2.5,3\n2,1.5,2.5,3\n3,2.5,3.5,3\n4,2.5,4.5,3\n",
        error="its first column counts the points: name the columns in its first line",
    ),
    _case("twice.csv", "x,y,z,X\n1,2,3,4\n", error="two columns are named x"),
    _case(
        "grid.asc",
        "ncols 4\nnrows 2\nNODATA_value -9999\n1 2 3 4\n5 6 7 8\n",
        error="2 names .* for 4 columns",
    ),
    _case(
        "ragged.xyz", "1 2 3\n4 5 6 7\n", error="not a table of numbers .*Expected 3 columns, got 4"
    ),
    _case("cut_decimals.csv", "1,5,2,05,3,1\n1,7,2,5,3,1\n", error="separate by semicolons"),
    _case("names_of_surveyors.csv", "E,N,H\n1,2,3\n", error="E, N, H\\); name three"),
    _case("two_columns.xyz", "1 2\n3 4\n", error="not a table of numbers"),
    _case("word_for_a_number.csv", "x,y,z\n1,2,3\n4,5,six\n", error="column z has 'six'"),
    _case("word_for_a_number.xyz", "1 2 3\n4 5 six\n", error="not a table of numbers"),
    _case("no_coordinates.csv", "a,b,c\n1,2,3\n", error="no x, y, z .columns: a, b, c"),
    _case("feet.csv", "X [ft],Y [ft],Z [ft]\n1,2,3\n", error="no x, y, z"),
    _case("binary.xyz", b"1 2 3\n\0\0\0", error="not a text file"),
    _case("page.xyz", "<!DOCTYPE html>\n<html>1 2 3</html>", error="an HTML page"),
    _case("unknown.abc", "1 2 3\n", error="not a point cloud by its name .*.ply, "),
]
